"""From a start and a goal to a graph of configurations between them, and the cheapest path through it."""

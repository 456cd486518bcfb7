"""What an arm does next: a situation, proposers in their order, an arbiter; and the planner around them."""

"""The paper's own experiments, and those on what was learned."""

"""A skill: what was learned from demonstrations, in a folder."""

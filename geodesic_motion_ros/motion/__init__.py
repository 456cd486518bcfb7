"""Certified motions: along paths, around obstacles, towards covered goals, and how one takes over from another."""

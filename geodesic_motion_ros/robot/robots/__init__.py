"""Robots that are shipped, a folder each: `description.py` says what is in it."""

"""Timed joint positions: from a path to a trajectory, and to a stop."""

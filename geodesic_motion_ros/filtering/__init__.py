"""Trajectories that others want an arm to play: checked, joined to what it plays, certified, and braked in time."""

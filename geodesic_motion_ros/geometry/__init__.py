"""Rotations, poses, curves, splines, shapes and distance fields; knows no robot."""

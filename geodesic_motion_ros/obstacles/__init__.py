"""Obstacles, and how they are tracked; knows nothing of ROS."""

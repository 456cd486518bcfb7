"""From a goal, obstacles and a skill to a certified trajectory; knows nothing of ROS."""

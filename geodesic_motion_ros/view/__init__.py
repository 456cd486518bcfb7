"""A page in the browser that shows an arm, its path and its obstacles, and takes what a user drags; knows no ROS."""

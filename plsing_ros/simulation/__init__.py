"""A simulated camera and whole servo runs, without ROS."""

"""Control law, controller cycle, monitor and simulated camera, without ROS."""

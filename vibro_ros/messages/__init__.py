"""The robot's topics and what its messages say, for the classes of any ROS library."""

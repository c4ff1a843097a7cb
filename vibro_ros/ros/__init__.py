"""The ROS 2 shell around the device: the only package that imports rclpy."""

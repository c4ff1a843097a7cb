"""Write, seal and read recordings: rosbag2 folders (MCAP) made and read with rosbags. No rclpy here."""

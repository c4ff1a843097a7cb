"""The page in the browser: what it draws, of a live robot and of a recording. No rclpy here."""

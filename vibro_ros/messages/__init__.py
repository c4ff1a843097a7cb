"""The robot's topics and what its messages say, for the classes of any ROS library.

In comes a sample of the device, its events and measurements; out go the bytes that are published and recorded.
`topics.py` comes first: `TOPICS` has a row for each topic, with type, quality of service, and which field of a sample
stands where. `robot_messages.py` fills and serialises the messages, for the node and for a replay alike, so that both
are equal to the last byte. `frames.py` and `urdf.py` say where the robot's parts are, `commands.py` what a command
message commands, `operations.py` what is asked of a run besides commands, as a text in the bag, and `codec.py` reads
and writes the bytes of any message without ROS. Nothing here imports rclpy.
"""

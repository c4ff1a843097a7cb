"""The robot's topics, and its messages as bytes, made and read without ROS.

In comes a sample of the device, its events and measurements; out go the bytes that are published and recorded.
Read `topics.py` first: `TOPICS` has a row for each topic, with its type, quality of service, and which field of a
sample fills which field of the message. `robot_messages.py` fills and serialises the messages, for the node and for a
replay alike, so that both make the same bytes; `topics.joint_commands` reads the commands in a JointState. `frames.py`
computes the transforms of the robot's parts, `urdf.py` its description, `operations.py` has the other inputs of a run
(reset, pause, push, ...) as the texts that a bag keeps, and `codec.py` serialises and deserialises any message. Nothing
here imports rclpy.
"""

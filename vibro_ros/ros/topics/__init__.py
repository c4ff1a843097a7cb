"""The robot's topics: messages out, commands in.

`publishers.py` comes first: it publishes and records what `messages.robot_messages` makes of a sample. In
`subscriptions.py` the stepping thread takes commands from DDS and gives them to the device; both record the bytes as
they are on the wire.
"""

"""The commands that the robot listens to."""

COMMAND_UNITS: dict[str, str] = {"motor_speed": "rad/s", "upper_gap": "m", "inclined_gap": "m"}
"""Unit of each command; the names are topics (std_msgs/msg/Float64) and arguments of `Simulator.command`."""

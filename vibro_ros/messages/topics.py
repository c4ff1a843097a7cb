"""The robot's topics: names, types, and the units of commands; ROS, bags and documents take them from here."""

COMMAND_UNITS = {"motor_speed": "rad/s", "upper_gap": "m", "inclined_gap": "m"}
"""Unit of each command; the names are topics and arguments of `Simulator.command`."""

ROBOT_TOPICS = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "ground_contact": "geometry_msgs/msg/WrenchStamped",
    "impacts": "geometry_msgs/msg/WrenchStamped",
    "motor_power": "std_msgs/msg/Float64",
    **dict.fromkeys(COMMAND_UNITS, "std_msgs/msg/Float64"),
}
"""Type of each topic; a topic in a bag that ends like one of these and has another type is somebody else's."""

CHECKPOINT = "checkpoint"
CHECKPOINT_TYPE = "std_msgs/msg/Float64MultiArray"
"""Only in bags that may lack a run's beginning: `Simulator.checkpoint` after a sample and before its commands."""

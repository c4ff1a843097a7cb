"""The robot's topics: names, types, and the units of commands; ROS, bags and documents take them from here."""

COMMAND_UNITS = {"motor_speed": "rad/s", "upper_gap": "m", "inclined_gap": "m"}
"""Unit of each command; the names are topics and arguments of `Simulator.command`."""

ROBOT_TOPICS = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "ground_contact": "geometry_msgs/msg/WrenchStamped",
    "impacts": "geometry_msgs/msg/WrenchStamped",
    "motor_power": "std_msgs/msg/Float64",
    "robot_description": "std_msgs/msg/String",
    "tf": "tf2_msgs/msg/TFMessage",
    "tf_static": "tf2_msgs/msg/TFMessage",
    **dict.fromkeys(COMMAND_UNITS, "std_msgs/msg/Float64"),
}
"""Type of each topic; a topic in a bag that ends like one of these and has another type is somebody else's."""

TF_TOPICS = ("tf", "tf_static")
"""Topics that all robots of a graph share, outside of namespaces, and that need a package which may be missing."""

LASTING = ("robot_description", "tf_static")
"""Topics on which one message says all: late subscribers get it, and each file of a bag begins with it."""

CHECKPOINT = "checkpoint"
CHECKPOINT_TYPE = "std_msgs/msg/Float64MultiArray"
"""Only in bags that may lack a run's beginning: `Simulator.checkpoint` after a sample and before its commands."""

OPERATIONS = "operations"
OPERATIONS_TYPE = "std_msgs/msg/String"
"""What was done to the run besides commands, `messages.operations`; under the node's own name, as the checkpoint."""

INPUTS = (*COMMAND_UNITS, OPERATIONS)
"""What decides the run, and does not follow from it."""


def published_name(topic: str) -> str:
    """The name under which the robot publishes one of its topics, before namespace and remapping."""
    return f"/{topic}" if topic in TF_TOPICS else topic

"""What the recorder's tests record, and where."""

from pathlib import Path

from vibro_ros.bag.recorder import Topic

TOPICS = (
    Topic("/odom", "nav_msgs/msg/Odometry", 10),
    Topic("/joint_states", "sensor_msgs/msg/JointState", 10),
    Topic("/impacts", "geometry_msgs/msg/WrenchStamped", 1000),
    Topic("/motor_power", "std_msgs/msg/Float64", 10),
)
POWER = TOPICS[3:]
METADATA = {"scene": "device", "parameters": "guide.angle: 0.87", "version": "0.1", "start": "2026-11-21T10:00:00"}


def mcap_file(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"

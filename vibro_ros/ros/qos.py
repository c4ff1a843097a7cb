"""Quality of service of each topic; outside tools rely on it."""

from rclpy.qos import QoSProfile, ReliabilityPolicy

COMMANDS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
SAMPLES = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
IMPACTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Deep, because none may be lost between two samples of a slow reader."""
DIAGNOSTICS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

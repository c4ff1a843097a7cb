"""Quality of service of each topic; outside tools rely on it."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

COMMANDS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
SAMPLES = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
IMPACTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Deep, because none may be lost between two samples of a slow reader."""
TRANSFORMS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""As every broadcaster of tf2 has it."""
LASTING = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Late subscribers get the last message."""
DIAGNOSTICS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
OPERATIONS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
CLOCK = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

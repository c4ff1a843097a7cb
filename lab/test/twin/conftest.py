"""Real processes and a node, as the tests of the device's nodes have them."""

from asking import call
from real_processes import bench, refusal, start

__all__ = ["bench", "call", "refusal", "start"]

"""Real processes and a node, as the tests of the device's nodes have them."""

from asking import call
from real_processes import bench, compiled, refusal, start

__all__ = ["bench", "call", "compiled", "refusal", "start"]

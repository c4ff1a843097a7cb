"""A second robot to compare with: heyoka, a general Taylor integrator with events, and modes written by hand.

The peer is written from the equations of docs/robot.md. Of this package the peer uses the parameters of a `Scene`, and
neither the compiled tables nor the solver. The peer needs the optional extra `bench`.
"""

from tools.peer.device import COLUMNS, DRIVEN, Peer, PeerRun

__all__ = ["COLUMNS", "DRIVEN", "Peer", "PeerRun"]

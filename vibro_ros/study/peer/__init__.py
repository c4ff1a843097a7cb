"""A second robot, to compare with: heyoka, a general Taylor integrator with events, and a mode automaton by hand.

Written from the model's equations; of this package it uses the `Scene`'s parameters, and no tables or solver. Needs the
optional extra `bench`.
"""

from vibro_ros.study.peer.device import COLUMNS, DRIVEN, Peer, PeerRun, integrate_heyoka

__all__ = ["COLUMNS", "DRIVEN", "Peer", "PeerRun", "integrate_heyoka"]

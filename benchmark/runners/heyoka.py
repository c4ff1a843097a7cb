"""heyoka: Taylor series of adaptive order with terminal events, the modes of a robot written for it by hand.

Its documentation advises the default tolerance; the cooldown of its events, which would hide the second of two events
in one instant, is off in both uses (`tools.peer` tells why).
"""

from importlib.metadata import version as _version

import numpy as np

from benchmark.contract import PLAIN, TUNED, Answer, Setting, UnableError

SETTINGS = [Setting(PLAIN, "tolerance as it comes", 2.220446049250313e-16),
            *(Setting(TUNED, f"tolerance {tolerance:g}", tolerance) for tolerance in (1e-6, 1e-9, 1e-12))]


def version():
    """Of the package."""
    return f"heyoka {_version('heyoka')}"


def prepare(problem, setting):
    """A compiled integrator that runs from the start."""
    from tools.peer import Peer
    from vibro_ros import load_scene

    try:
        peer = Peer(load_scene("paper").with_parameters(problem.scene()), setting.value)
    except ValueError as error:
        raise UnableError(str(error)) from error
    times = np.array(problem.times)

    def run():
        found = peer.integrate(times)
        kinds, counts = np.unique(found.events["kind"], return_counts=True)
        return Answer(found.samples, {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)})

    return run

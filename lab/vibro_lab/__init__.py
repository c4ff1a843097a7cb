"""Studies of the robot that `vibro_ros` simulates: orbits and their stability, sweeps, identification, a twin.

A scene or a recording comes in; long-term motions, parameters with intervals, tables and figures go out. `orbits` has
the periodic motions, `study` the executable of that name, `identification` finds the parameters of a recorded robot,
`accuracy` compares methods and programs, `gym` is an environment of Gymnasium, and `twin` follows a robot online; it
alone imports rclpy. All of them use the device by the public interface of `vibro_ros`, and nothing below it.
"""

from importlib import import_module

TYPE_CHECKING = False
if TYPE_CHECKING:
    from vibro_lab.identification.identify import identify
    from vibro_lab.orbits.attractors import attractors
    from vibro_lab.orbits.branch import follow_orbit
    from vibro_lab.orbits.chaos import lyapunov_spectrum
    from vibro_lab.orbits.orbit import find_orbit
    from vibro_lab.orbits.recurrence import settled_motion

__all__ = ["attractors", "find_orbit", "follow_orbit", "identify", "lyapunov_spectrum",
           "settled_motion"]

_HOMES = {
    "attractors": "orbits.attractors",
    "find_orbit": "orbits.orbit",
    "follow_orbit": "orbits.branch",
    "identify": "identification.identify",
    "lyapunov_spectrum": "orbits.chaos",
    "settled_motion": "orbits.recurrence",
}


def __getattr__(name: str) -> object:
    """Import a public name at its first use."""
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__, "__version__"])

"""A vibro-impact robot as a virtual device, with physics to be trusted to the last digit.

A scene comes in, with every parameter of the machine (`load_scene`); motions go out. `simulate` computes whole runs,
`Simulator` is a device that takes commands while it runs, `SensedSimulator` is a device with sensors, and `find_orbit`
computes a periodic motion. `model` has the physics, as modes and guards; `solver` finds the events between two modes
and knows nothing of robots; `simulation` makes the device from both. The other rooms use the device: `orbits`,
`sensors`, `bag` (recordings), `recordings` (programs for recordings), `accuracy`, `study`, `view` (the page) and `ros`,
which alone imports rclpy. Read `simulation/simulator.py` first, then `docs/architecture.md`.
"""

from importlib import import_module

TYPE_CHECKING = False  # type checkers know the name; to import `typing` would delay what an executable does first
if TYPE_CHECKING:
    from vibro_ros.bag.reader import read_bag
    from vibro_ros.configuration.scene_file import load_scene
    from vibro_ros.identification.identify import identify
    from vibro_ros.model.scene import Scene
    from vibro_ros.orbits.attractors import attractors
    from vibro_ros.orbits.branch import follow_bifurcation, follow_orbit
    from vibro_ros.orbits.chaos import lyapunov_spectrum, zero_one_test
    from vibro_ros.orbits.orbit import find_orbit
    from vibro_ros.orbits.recurrence import settled_motion
    from vibro_ros.sensors.device import SensedSimulator
    from vibro_ros.simulation.motion import SimulationError
    from vibro_ros.simulation.runs import simulate, simulate_many
    from vibro_ros.simulation.simulator import Simulator

__all__ = ["Scene", "SensedSimulator", "SimulationError", "Simulator", "attractors", "find_orbit",
           "follow_bifurcation", "follow_orbit", "identify", "load_scene", "lyapunov_spectrum", "read_bag",
           "settled_motion", "simulate", "simulate_many", "zero_one_test"]

_HOMES = {
    "Scene": "model.scene",
    "SensedSimulator": "sensors.device",
    "SimulationError": "simulation.motion",
    "Simulator": "simulation.simulator",
    "attractors": "orbits.attractors",
    "find_orbit": "orbits.orbit",
    "follow_bifurcation": "orbits.branch",
    "follow_orbit": "orbits.branch",
    "identify": "identification.identify",
    "load_scene": "configuration.scene_file",
    "lyapunov_spectrum": "orbits.chaos",
    "read_bag": "bag.reader",
    "settled_motion": "orbits.recurrence",
    "simulate": "simulation.runs",
    "simulate_many": "simulation.runs",
    "zero_one_test": "orbits.chaos",
}


def __getattr__(name: str) -> object:
    """Import a public name at its first use: a program that reads bags needs no kernels (65 MB), one that simulates
    needs no bags.
    """
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__, "__version__"])

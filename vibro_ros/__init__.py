"""A vibro-impact robot as a virtual device, with physics to be trusted to the last digit.

In comes a scene, every parameter of the machine: `load_scene`. Out come motions: `simulate` makes whole runs,
`Simulator` is the device that is commanded as it goes on, `SensedSimulator` the same with its sensors, `find_orbit` a
motion that repeats itself. `model` has the physics, as modes and guards; `solver` finds the events between two modes
and knows nothing of robots; `simulation` makes the device of both. Around it stand `orbits`, `sensors`, `bag`
(recordings), `recordings` (what is done with them), `accuracy`, `study`, `view` (the page) and `ros`, which alone
imports rclpy. Read `simulation/simulator.py` first, then `docs/architecture.md`.
"""

from importlib import import_module

TYPE_CHECKING = False  # type checkers know the name; to import `typing` would delay what an executable does first
if TYPE_CHECKING:
    from vibro_ros.bag.reader import read_bag
    from vibro_ros.configuration.scene_file import load_scene
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
           "follow_bifurcation", "follow_orbit", "load_scene", "lyapunov_spectrum", "read_bag", "settled_motion",
           "simulate", "simulate_many", "zero_one_test"]

_HOMES = {
    "Scene": "model.scene",
    "SensedSimulator": "sensors.device",
    "SimulationError": "simulation.motion",
    "Simulator": "simulation.simulator",
    "attractors": "orbits.attractors",
    "find_orbit": "orbits.orbit",
    "follow_bifurcation": "orbits.branch",
    "follow_orbit": "orbits.branch",
    "load_scene": "configuration.scene_file",
    "lyapunov_spectrum": "orbits.chaos",
    "read_bag": "bag.reader",
    "settled_motion": "orbits.recurrence",
    "simulate": "simulation.runs",
    "simulate_many": "simulation.runs",
    "zero_one_test": "orbits.chaos",
}


def __getattr__(name: str) -> object:
    """Import what is asked for: who reads bags needs no kernels (65 MB), who simulates no bags."""
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__, "__version__"])

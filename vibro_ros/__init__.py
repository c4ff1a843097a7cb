"""A vibro-impact robot as a virtual device, with physics to be trusted to the last digit."""

from vibro_ros.model.scene import Scene
from vibro_ros.parallel import simulate_many
from vibro_ros.scene_file import load_scene
from vibro_ros.simulator import SimulationError, Simulator, simulate

__all__ = ["Scene", "SimulationError", "Simulator", "load_scene", "simulate",
           "simulate_many"]

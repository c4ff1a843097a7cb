"""A vibro-impact robot as a virtual device, with physics to be trusted to the last digit.

A scene comes in, with every parameter of the machine (`load_scene`); motions go out. `simulate` computes whole runs,
`Simulator` is a device that takes commands while it runs, and `SensedSimulator` is a device with sensors. `model` has
the physics, as modes and guards; `solver` finds the events between two modes and knows nothing of robots; `simulation`
makes the device from both. The other rooms use the device: `sensors`, `bag` (recordings), `recordings` (programs for
recordings), `view` (the page) and `ros`, which alone imports rclpy. Read `simulation/simulator.py` first, then
`docs/architecture.md`. Studies of the robot are the package `vibro_lab`.

The table `_NAMES_OF` below is the public interface, by what a program wants to do. Other packages import these names
from `vibro_ros`, and the frame of a ROS node from `vibro_ros.ros`; all else may change with any version.
"""

from importlib import import_module

TYPE_CHECKING = False  # type checkers know the name; to import `typing` would delay what an executable does first
if TYPE_CHECKING:
    from vibro_ros.bag.reader import read_bag
    from vibro_ros.bag.stream import BagError, BagStream, bag_errors, robot_topics
    from vibro_ros.configuration.scene_file import find_file, load_scene, scene_as_file, scene_origin, shipped
    from vibro_ros.configuration.strict_yaml import read_scalar, read_settings, read_yaml
    from vibro_ros.messages.codec import deserialised
    from vibro_ros.messages.frames import JOINTS, joints_of
    from vibro_ros.messages.operations import read_operation
    from vibro_ros.messages.topics import COMMANDS, TOPICS, commands_in, commands_of
    from vibro_ros.model.faults import Incident
    from vibro_ros.model.parameters import BY_NAME as PARAMETERS
    from vibro_ros.model.parameters import Parameter, Value, checked_parameters, parameter_named, quoted
    from vibro_ros.model.scene import Scene, check_scene
    from vibro_ros.process.entry_point import Parser, StopRequest, enter, exit_code, interrupted_code, say
    from vibro_ros.process.files import is_temporary, read_file, replace_file
    from vibro_ros.process.pictures import default_settings, new_figure, png, set_heading
    from vibro_ros.sensors.device import SensedSimulator
    from vibro_ros.sensors.noise import ACCELERATIONS, force_at_rest, of_imu
    from vibro_ros.sensors.noise import FORGETTING as IMU_FORGETTING
    from vibro_ros.simulation.given_state import STATE_UNITS, motor_coordinates
    from vibro_ros.simulation.motion import SimulationError
    from vibro_ros.simulation.provenance import software
    from vibro_ros.simulation.runs import simulate, simulate_many
    from vibro_ros.simulation.samples import FIELDS as SAMPLE_FIELDS
    from vibro_ros.simulation.samples import LATEST as LATEST_TIME
    from vibro_ros.simulation.samples import Samples
    from vibro_ros.simulation.simulator import Simulator, ToleranceWarning
    from vibro_ros.simulation.workers import Forks, InThisProcess, core_count, in_order, in_processes

__all__ = ["ACCELERATIONS", "BagError", "BagStream", "COMMANDS", "Forks", "IMU_FORGETTING", "InThisProcess",
           "Incident", "JOINTS", "LATEST_TIME", "PARAMETERS", "Parameter", "Parser", "SAMPLE_FIELDS",
           "STATE_UNITS", "Samples", "Scene", "SensedSimulator", "SimulationError", "Simulator", "StopRequest",
           "TOPICS", "ToleranceWarning", "Value", "bag_errors", "check_scene", "checked_parameters", "commands_in",
           "commands_of", "core_count", "default_settings", "deserialised", "enter", "exit_code", "find_file",
           "force_at_rest", "in_order", "in_processes", "interrupted_code", "is_temporary", "joints_of", "load_scene",
           "motor_coordinates", "new_figure", "of_imu", "parameter_named", "png", "quoted", "read_bag", "read_file",
           "read_operation", "read_scalar", "read_settings", "read_yaml", "replace_file", "robot_topics", "say",
           "scene_as_file", "scene_origin", "set_heading", "shipped", "simulate", "simulate_many", "software"]

_NAMES_OF = {  # public names by their module; after a colon the name there, if it differs
    # scenes, and where the shipped files are
    "model.scene": "Scene check_scene",
    "configuration.scene_file": "find_file load_scene scene_as_file scene_origin shipped",
    # parameters: their table, and checked values
    "model.parameters": "PARAMETERS:BY_NAME Parameter Value checked_parameters parameter_named quoted",
    # a device that takes commands while it runs, whole runs, many at once, and what decides their bits
    "simulation.simulator": "Simulator ToleranceWarning",
    "simulation.runs": "simulate simulate_many",
    "simulation.workers": "Forks InThisProcess core_count in_order in_processes",
    "simulation.samples": "LATEST_TIME:LATEST SAMPLE_FIELDS:FIELDS Samples",
    "simulation.given_state": "STATE_UNITS motor_coordinates",
    "simulation.motion": "SimulationError",
    "simulation.provenance": "software",
    "model.faults": "Incident",
    # sensors
    "sensors.device": "SensedSimulator",
    "sensors.noise": "ACCELERATIONS IMU_FORGETTING:FORGETTING force_at_rest of_imu",
    # recordings
    "bag.reader": "read_bag",
    "bag.stream": "BagError BagStream bag_errors robot_topics",
    # topics and messages
    "messages.topics": "COMMANDS TOPICS commands_in commands_of",
    "messages.frames": "JOINTS joints_of",
    "messages.codec": "deserialised",
    "messages.operations": "read_operation",
    # the frame of an executable, and the files that it reads and writes
    "process.entry_point": "Parser StopRequest enter exit_code interrupted_code say",
    "process.files": "is_temporary read_file replace_file",
    "configuration.strict_yaml": "read_scalar read_settings read_yaml",
    # pictures that do not depend on the user's settings of matplotlib
    "process.pictures": "default_settings new_figure png set_heading",
}
_HOMES = {name.partition(":")[0]: f"{module}:{name.rpartition(':')[2]}"
          for module, names in _NAMES_OF.items() for name in names.split()}
_OF_THE_LAB = ("attractors", "find_orbit", "follow_orbit", "identify", "lyapunov_spectrum", "settled_motion")
_GONE = {
    "follow_bifurcation": "follow the branch with vibro_lab.follow_orbit at several values of the second parameter, "
                          "and join its `special_points`",
    "zero_one_test": "vibro_lab.lyapunov_spectrum tells chaos by the sign of the largest exponent, with its interval"}


def __getattr__(name: str) -> object:
    """Import a public name at its first use: who reads bags needs no kernels (65 MB), who simulates needs no bags."""
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name in _HOMES:
        module, _, name_there = _HOMES[name].partition(":")
        return getattr(import_module(f"{__name__}.{module}"), name_there)
    if name in _OF_THE_LAB:
        raise AttributeError(f"vibro_ros.{name} is vibro_lab.{name} since version 2.0.0; install the package vibro_lab "
                             "(`pip install ./lab` in a clone) and `import vibro_lab`")
    if name in _GONE:
        raise AttributeError(f"vibro_ros.{name} is gone since version 2.0.0; {_GONE[name]}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__, "__version__"])

"""Scenes and device parameters from ordinary ROS parameter files."""

from collections.abc import Iterator
from pathlib import Path

from vibro_ros.model.parameters import SCENE_PARAMETERS, Parameter, known
from vibro_ros.model.scene import Scene
from vibro_ros.shipped import config_folder
from vibro_ros.strict_yaml import read_yaml

#: Parameters of the device around the physics; scenes do not contain them.
DEVICE_PARAMETERS: tuple[Parameter, ...] = (
    Parameter("scene", "device", "", "a shipped scene's name, or a path to a parameter file"),
    Parameter("frame_prefix", "", "", "put before the name of every frame as it is, such as r1/ for one of two robots"),
    Parameter("rate.publish", 200.0, "Hz", "rate at which the states are published", minimum=0.1, maximum=1e4),
    Parameter("rate.real_time_factor", 1.0, "", "simulated seconds per second; 0 = as fast as it can",
              minimum=0.0, maximum=1e3),
    Parameter("rate.max_catch_up", 0.1, "s", "longest stall that is caught up; time beyond it is dropped",
              minimum=0.0, maximum=1e3),
    Parameter("record.enabled", True, "", "record a bag from the start"),
    Parameter("record.directory", ".", "", "where the time-stamped folder of the bag is made"),
    Parameter("record.topics", ("all",), "", "topics to record, such as [odom, motor_speed]; [all] records every one"),
    Parameter("record.storage", "mcap", "", "file format of the bag", choices=("mcap", "sqlite3")),
    Parameter("record.compression", "none", "", "compression of an MCAP bag's chunks", choices=("none", "zstd")),
    Parameter("record.max_size", 0.0, "B", "a file of the bag is followed by another before it exceeds this; 0 = never",
              minimum=0.0, maximum=1e18),
    Parameter("record.max_duration", 0.0, "s", "the same by robot time; 0 = never", minimum=0.0, maximum=1e9),
    Parameter("record.max_bytes", 0.0, "B", "the bag's oldest file is deleted before the bag exceeds this; 0 = never",
              minimum=0.0, maximum=1e18),
    Parameter("record.snapshot", 0.0, "s", "keep only so much in memory, and write it when the simulation fails or "
              "`~/record` asks; 0 = record everything at once", minimum=0.0, maximum=3600.0),
    Parameter("record.recover", False, "", "seal bags that a killed robot left in record.directory; false: say how"),
)


def shipped_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with the package."""
    return tuple(sorted(path.stem for path in (config_folder() / "scenes").glob("*.yaml")))


def load_scene(name_or_path: str | Path) -> Scene:
    """A shipped scene by its name, or the scene of a parameter file.

    Parameters of the device (`DEVICE_PARAMETERS`) in the file are checked and left aside.

    Raises
    ------
    ValueError
        If there is no such scene or file, or the file is not a valid parameter file; the message
        names the file, the value, the limit and the remedy.
    """
    path = _scene_path(str(name_or_path))
    values = read_parameter_file(path)
    by_name = {parameter.name: parameter for parameter in (*SCENE_PARAMETERS, *DEVICE_PARAMETERS)}
    device = {parameter.name for parameter in DEVICE_PARAMETERS}
    try:
        checked = {name: known(name, by_name).checked(value) for name, value in values.items()}
        return Scene(path.stem, {name: value for name, value in checked.items() if name not in device})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _scene_path(name: str) -> Path:
    if name in shipped_scenes():
        return config_folder() / "scenes" / f"{name}.yaml"
    path = Path(name)
    if path.is_file():
        return path
    raise ValueError(f"{name}: neither a shipped scene nor a file; shipped scenes are {', '.join(shipped_scenes())}")


def read_parameter_file(path: str | Path) -> dict[str, object]:
    """Parameters of a ROS parameter file, by dotted name, unchecked.

    Every node's `ros__parameters` of the file are read (`/**` or a node's name).

    Raises
    ------
    ValueError
        If the file is missing, is not YAML, or has another structure.
    """
    content = read_yaml(Path(path))
    values: dict[str, object] = {}
    if not isinstance(content, dict):
        raise ValueError(f"{path}: is not a parameter file; write '/**:' and below it 'ros__parameters:'")
    for node, body in content.items():
        if not isinstance(body, dict) or set(body) != {"ros__parameters"} or not isinstance(
                body["ros__parameters"], dict):
            raise ValueError(f"{path}: {node}: holds no 'ros__parameters:'; write the parameters below that key")
        values |= _flat(body["ros__parameters"], path)
    return values


def _flat(tree: dict, path: str | Path) -> dict[str, object]:
    flat: dict[str, object] = {}
    try:
        leaves = list(_leaves(tree, ""))
    except RecursionError:
        raise ValueError(f"{path}: a mapping contains itself; write it out") from None
    for name, value in leaves:
        if name in flat:
            raise ValueError(f"{path}: {name}: is given twice, dotted and nested; keep one")
        flat[name] = value
    return flat


def _leaves(tree: dict, prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value

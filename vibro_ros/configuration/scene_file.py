"""Load scenes from ordinary ROS parameter files; the table of the device's parameters; where the shipped files are."""

import os
from pathlib import Path

import yaml

from vibro_ros.configuration.parameter_file import absolute, check_addressed, merged, own_parameters, sections
from vibro_ros.model.parameters import SCENE_PARAMETERS, Parameter, checked_parameters, nearest
from vibro_ros.model.scene import Scene
from vibro_ros.process.files import user_path

NODE_NAME = "vibro_robot"

NO_NODES = ("none",)  # default of `clock.lock_step`: ROS has no empty list of texts

ZEROS = (0.0,) * 6

#: Parameters of the node around the physics; a scene does not contain them.
DEVICE_PARAMETERS: tuple[Parameter, ...] = (
    Parameter("scene", "device", "", "name of a shipped scene, or path of a parameter file, which changes the scene "
              "that its own `scene` names"),
    Parameter("frame_prefix", "", "", "put before the name of every frame as it is, such as r1/ for one of two robots"),
    Parameter("tf.publish", "all", "", "frames on /tf: none; base_link in odom, beside a robot_state_publisher; or all "
              "of the robot", choices=("none", "base", "all")),
    Parameter("odom.pose_covariance_diagonal", ZEROS, "", "variances of x, y, z [m²] and of the rotations about them "
              "[rad²] in the pose of odom; zeros: odom is the truth", minimum=0.0, maximum=1e12),
    Parameter("odom.twist_covariance_diagonal", ZEROS, "", "likewise of the twist of odom [m²/s², rad²/s²]",
              minimum=0.0, maximum=1e12),
    Parameter("rate.publish", 200.0, "Hz", "rate at which the states are published", minimum=0.1, maximum=1e4),
    Parameter("rate.real_time_factor", 1.0, "", "simulated seconds per second; 0 = as fast as it can",
              minimum=0.0, maximum=1e3, while_running=True, smallest=1e-6),
    Parameter("rate.max_catch_up", 0.1, "s", "longest stall that is caught up; time beyond it is dropped",
              minimum=0.0, maximum=1e3),
    Parameter("rate.start_paused", False, "", "robot time stands still until `~/pause` is called with false"),
    Parameter("clock.publish", False, "", "publish robot time on /clock after each sample; stamps then count from 0"),
    Parameter("clock.lock_step", NO_NODES, "", "nodes that must have run all callbacks of a sample before the "
              "robot takes the next one, such as [/vibro_controller]; [none]: no node; needs clock.publish"),
    Parameter("command.timeout", 0.0, "s", "robot time without a motor_speed after which the motor stops; "
              "0 = never", minimum=0.0, maximum=1e6),
    Parameter("ros2_control", False, "", "put a block into robot_description by which ros2_control commands the robot"),
    Parameter("record.enabled", True, "", "record a bag from the start"),
    Parameter("record.directory", ".", "", "where the time-stamped folder of the bag is made"),
    Parameter("record.topics", ("all",), "", "topics to record, such as [odom, motor_speed]; [all] records every one"),
    Parameter("record.compression", "none", "", "compression of the bag's chunks", choices=("none", "zstd")),
    Parameter("record.max_size", 0.0, "B", "a file of the bag larger than this is followed by another; 0 = never",
              minimum=0.0, maximum=1e18),
    Parameter("record.max_duration", 3600.0, "s", "a file of the bag with a longer robot time is followed by "
              "another; 0 = never, at 12 MB of memory an hour",
              minimum=0.0, maximum=1e9),
    Parameter("record.max_bytes", 0.0, "B", "the bag's oldest file is deleted before the bag exceeds this; 0 = never",
              minimum=0.0, maximum=1e18),
    Parameter("record.recover", False, "", "seal bags that a killed robot left in record.directory; false: "
              "only say how to"),
)


def shipped_scenes() -> tuple[str, ...]:
    """Return the names of the scenes that come with the package."""
    return shipped("scene")


def load_scene(name_or_path: str | Path, node: str | None = None) -> Scene:
    """Load a shipped scene by its name, or the scene of a ROS parameter file.

    The parameters that ROS would give to the robot's node count. The file's parameter `scene` names the scene that they
    change, so that the file gives the same robot here as with `--params-file`; a relative path in it starts from the
    file's folder. Without `scene` they change the paper's values (with `--params-file`, those of the node's default
    scene). Parameters of the device (`DEVICE_PARAMETERS`) are checked and then ignored; those of every ROS node
    (`use_sim_time`) are ignored.

    Parameters
    ----------
    name_or_path : str or Path
        A shipped scene's name, or a file: one written by hand, or by ``ros2 param dump``.
    node : str, optional
        Fully qualified name of the node whose parameters are read. By default the node `vibro_robot`, in the one
        namespace in which the file names it.

    Raises
    ------
    ValueError
        If there is no such scene or file, the file is not a valid parameter file, or its chain of scenes leads back to
        it; the message names the file, the value, the limit and the remedy.

    Examples
    --------
    >>> vibro_ros.load_scene("rigid")["effects.upper_contact"]
    'restitution'
    """
    return _load(find_file("scene", str(name_or_path), Path()), node, ())


def scene_as_file(scene: Scene, comment: str) -> bytes:
    """Return a scene file with the value of every parameter of `scene`; `comment` is its first line."""
    text = yaml.safe_dump({"/**": {"ros__parameters": {"scene": "paper", **scene.parameters}}}, sort_keys=False)
    return f"# {comment}\n{text}".encode()


def scene_origin(name: str, folder: Path) -> str:
    """Return a shipped scene's name as it is, else an absolute path, from `folder` on (ValueError if neither is)."""
    return name if name in shipped_scenes() else str(find_file("scene", name, folder).absolute())


def _load(path: Path, node: str | None, above: tuple[Path, ...]) -> Scene:
    """Load the scene of a file; `above` is the chain of files that led here, each based on the next."""
    if path.resolve() in above:
        raise ValueError(f"{path}: as a scene it is a change of itself; let its `scene` be one of "
                         f"{', '.join(shipped_scenes())}")
    given = sections(path)
    named = {absolute(pattern) for pattern, _ in given if "*" not in pattern}
    robots = sorted(name for name in named if name.rpartition("/")[2] == NODE_NAME)
    if not node and len(robots) > 1:
        raise ValueError(f"{path}: holds parameters for {', '.join(robots)}; name one of them: "
                         f"load_scene(..., node={robots[0]!r})")
    robot = node or (robots[0] if robots else f"/{NODE_NAME}")
    check_addressed(path, given, robot)
    try:
        checked = checked_parameters(own_parameters(merged(given, robot)), (*SCENE_PARAMETERS, *DEVICE_PARAMETERS))
        base = find_file("scene", checked["scene"], path.parent) if "scene" in checked else None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    base_parameters = _load(base, node, (*above, path.resolve())).parameters if base else {}
    device = {parameter.name for parameter in DEVICE_PARAMETERS}
    try:
        changes = {name: value for name, value in checked.items() if name not in device}
        return Scene(path.stem, {**base_parameters, **changes})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


FOLDERS = {"scene": ("scenes", ".yaml"), "script": ("controller", ".yaml")}
"""Folder below `config_folder()` and file suffix of each kind of file."""


def shipped(kind: str) -> tuple[str, ...]:
    """Return the names, sorted, of the files of a kind in `FOLDERS` that come with the package."""
    folder, suffix = FOLDERS[kind]
    return tuple(sorted(path.stem for path in (config_folder() / folder).glob(f"*{suffix}")))


def find_file(kind: str, name_or_path: str, folder: Path | None = None) -> Path:
    """Return the path of a shipped file or of a user's; a relative path starts from `folder` or the current folder.

    ValueError when there is neither a shipped file of this name nor a file at this path; the message lists the shipped
    ones.
    """
    if name_or_path in shipped(kind):
        subfolder, suffix = FOLDERS[kind]
        return config_folder() / subfolder / f"{name_or_path}{suffix}"
    path = (folder or Path()) / user_path(name_or_path)
    if os.path.isfile(path):  # false, not an error, for an impossible file name
        return path
    names = f"shipped {kind}s are {', '.join(shipped(kind))}"
    if not name_or_path:
        raise ValueError(f"no {kind} is given; give the path of a file, or a shipped one: {names}")
    question = nearest(name_or_path, shipped(kind))
    raise ValueError(f"{name_or_path}: neither a shipped {kind} nor a file; {question}{' ' * bool(question)}{names}")


def config_folder() -> Path:
    """Return the folder of the shipped configuration: scenes, scripts and the robot's parameter file.

    It is found in a source checkout, a pip installation and a colcon workspace. FileNotFoundError if the package was
    installed without its data.
    """
    package = Path(__file__).resolve().parents[1]
    # <prefix>/lib/python3.x/site-packages/vibro_ros; Debian puts `local/` before `lib/`.
    underlays = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    candidates = [prefix / "share" / "vibro_ros" / "config"
                  for prefix in [*package.parents[:5], *map(Path, underlays)]]
    if (package.parent / "package.xml").is_file():
        candidates.insert(0, package.parent / "config")
    for folder in candidates:
        if folder.is_dir():
            return folder
    looked_for = ", ".join(map(str, candidates))
    raise FileNotFoundError(f"vibro_ros is installed without its config folder (looked for {looked_for}); reinstall it")

"""The list of executables: setup.py installs from it, `entry_point.enter` starts from it; documents and tests use it.

setup.py runs this file before anything is installed, so the file imports nothing but the standard library.
"""

from collections import namedtuple

Executable = namedtuple("Executable", ["module", "installed", "does", "endless"], defaults=[False])
Executable.__doc__ = """One executable.

`main` of its `module` takes the words of the command line and returns the exit code. If it is `installed`,
`ros2 run vibro_ros NAME` and `.venv/bin/NAME` start it; `python -m MODULE` starts every one. `does` is the first
sentence of its `--help`. An `endless` one normally ends by a signal, with exit code 0; the others then exit with 128 +
the signal's number.
"""

EXECUTABLES = {
    "robot": Executable(
        "vibro_ros.ros.robot.robot", True,
        "Run the vibro-impact robot as a ROS 2 device, until SIGINT, SIGTERM or SIGHUP.", endless=True),
    "controller": Executable(
        "vibro_ros.ros.controller.controller", True,
        "Play a script of commands to the robot."),
    "report": Executable(
        "vibro_ros.recordings.report", True,
        "Sum up a recording of the robot as text and JSON, and draw its motion."),
    "replay": Executable(
        "vibro_ros.recordings.replay", True,
        "Simulate a recorded run again and compare it to the last bit, or vary it."),
    "view": Executable(
        "vibro_ros.view.view", True,
        "Show the robot in the browser: a recording as one HTML file, or a live robot with its knobs."),
    "recover": Executable(
        "vibro_ros.recordings.recover", True,
        "Seal bags whose recorder was killed or ran out of disk, or that were damaged since."),
    "live_view": Executable(
        "vibro_ros.ros.live.view", False,
        "Show a live robot in the browser, with its knobs and buttons, until SIGINT, SIGTERM or SIGHUP.", endless=True),
}
"""All executables by name, the installed ones first."""


def shows_live_robot(words):
    """Return whether the arguments of `view` ask for a live robot, not for a recording."""
    of_recording = ("--output", "--scene", "--help", "-h", "--version")
    return not words or words[0].startswith("-") and words[0].partition("=")[0] not in of_recording

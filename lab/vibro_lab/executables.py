"""The lab's executables: setup.py installs from this list, and `vibro_ros.enter` starts each of them.

setup.py runs this file before anything is installed, so it imports nothing but the standard library.
"""

from collections import namedtuple
from collections.abc import Callable
from functools import partial

Executable = namedtuple("Executable", ["module", "does", "endless"], defaults=[False])
Executable.__doc__ = """One executable, as `vibro_ros.enter` takes it.

Attributes
----------
module : str
    Module whose `main` takes the words of the command line and returns the exit code.
does : str
    What it does, in one sentence: the first of its `--help`.
endless : bool
    Whether its normal end is a signal, with exit code 0.
"""

EXECUTABLES = {
    "accuracy": Executable(
        "vibro_lab.accuracy.accuracy",
        "Measure error over cost for every method: advice, rows and a diagram for each scene."),
    "study": Executable(
        "vibro_lab.study.command", "Study the machine: sweeps, the optimum, orbits, diagrams, basins, maps."),
    "twin": Executable(
        "vibro_lab.twin.twin", "Follow a robot by its sensors: estimate its motion and parameters, and name its fault.",
        endless=True),
}
"""All executables by name; `ros2 run vibro_lab NAME` and `.venv/bin/NAME` start them."""


def __getattr__(name: str) -> Callable[[], int]:
    """Return the function that the console script of an executable calls, such as `study`."""
    if name in EXECUTABLES:
        from vibro_ros import enter  # not at setup.py's time
        return partial(enter, name, EXECUTABLES)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""Options that studies share: the machine, and who computes."""

import argparse
from collections.abc import Sequence

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.model.parameters import BY_NAME, Value, parameter_named
from vibro_ros.model.scene import Scene
from vibro_ros.process.front_door import Parser
from vibro_ros.simulation.processes import core_count
from vibro_ros.study.running.runner import Runner, on_cluster, on_this_machine
from vibro_ros.study.sweep.variation import whole_number

MOST_WORKERS = 4096
"""Processes that may be asked for."""


def add_machine(parser: Parser, scene: str) -> None:
    """Add `--scene`, by default `scene`, and `--set`."""
    parser.add_argument("--scene", default=scene, metavar="NAME", help="shipped scene or scene file (default: "
                        "%(default)s)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="another value of the scene, "
                        "SI units, angles in rad; repeatable")


def machine_of(options: argparse.Namespace) -> Scene:
    """The machine that `--scene` and `--set` name (ValueError)."""
    return load_scene(options.scene).with_parameters(settings_of(options.set))


def settings_of(words: Sequence[str]) -> dict[str, Value]:
    """The values that `--set NAME=VALUE` gives, each checked.

    Raises
    ------
    ValueError
        For a name or value that is none, and for a name that is given twice.
    """
    found: dict[str, Value] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise ValueError(f"--set {word}: give NAME=VALUE, such as ground.friction=0.3")
        if name in found:
            raise ValueError(f"--set: {name} is given twice; keep one")
        found[name] = parameter_named(name, BY_NAME).checked(read_scalar(value))
    return found


def add_runner(parser: Parser) -> None:
    """Add `--workers` and `--scheduler`."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="processes on this machine (default: one a core); they "
                       "change no number")
    where.add_argument("--scheduler", metavar="ADDRESS", help="compute on the Dask cluster of this scheduler, such as "
                       "tcp://host:8786; the numbers are the same to the last bit")


def runner_of(options: argparse.Namespace) -> Runner:
    """Who computes, by `--workers` or `--scheduler` (ValueError)."""
    if options.scheduler:
        return on_cluster(options.scheduler)
    workers = core_count() if options.workers is None else options.workers
    return on_this_machine(whole_number("--workers", workers, 1, MOST_WORKERS))

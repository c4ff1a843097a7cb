"""`study optimise`: search, verify, and write what was found."""

import argparse
import re
from collections.abc import Sequence
from dataclasses import replace

from vibro_ros.accuracy.figures import png
from vibro_ros.accuracy.harness import running
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.parameters import BY_NAME, parameter_named
from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import Parser
from vibro_ros.study.command import (
    add_execution,
    execution_of,
    locked,
    run_study,
    settings_of,
    study_parser,
    write_files,
)
from vibro_ros.study.optimise.plan import DIRECTIONS, FRONT, OBJECTIVES, POWERS, QUICK, Effort, Plan, Reading
from vibro_ros.study.optimise.result import Result, result_file, scene_file, studied
from vibro_ros.study.optimise.search import Candidates
from vibro_ros.study.optimise.space import Space, chosen_variables
from vibro_ros.study.optimise.text import document, draw_convergence, draw_front, draw_sensitivity, on_bounds, title

FOLDER, TEXT, SCENE, NUMBERS = "candidates", "optimum.md", "optimum.yaml", "optimum.json"
_MOST = {"budget": 10**6, "starts": 1000, "seed": 2**31 - 2}
_LEAST = {"budget": 1, "starts": 2, "seed": 0}
_VARIED = re.compile(r"([^=]+)=([^:]+):([^:]+)")


def main(words: Sequence[str]) -> int:
    """Run the study; returns the exit code."""
    return run_study(_optimise, parser(), words)


def _optimise(options: argparse.Namespace) -> int:
    plan, execution, folder = plan_of(options), execution_of(options), options.output
    with locked(folder):
        (folder / FOLDER).mkdir(exist_ok=True)
        result, candidates = studied(plan, folder / FOLDER, execution)
        write_files(folder, files_of(result, candidates))
    print(folder / FOLDER)
    print(on_bounds(result))
    return 0


def plan_of(options: argparse.Namespace) -> Plan:
    """What the command line asks for.

    Raises
    ------
    ValueError
        For an option that makes no sense.
    """
    for name in _MOST:
        value = getattr(options, name)
        if value is not None and not _LEAST[name] <= value <= _MOST[name]:
            raise ValueError(f"--{name} {value}: give a number from {_LEAST[name]} to {_MOST[name]}")
    if not 0.0 <= options.least_speed <= 100.0:
        raise ValueError(f"--least-speed {options.least_speed:g}: give a number from 0 to 100 m/s")
    if not 0.0 <= options.most_air <= 1.0:
        raise ValueError(f"--most-air {options.most_air:g}: give a share from 0 to 1")
    fixed, varied = _fixed(options.fix), _varied(options.vary)
    scene = sought(load_scene(options.scene).with_parameters(settings_of(options.set) | {
        name: value for name, value in fixed.items() if value is not None}))
    effort = QUICK if options.quick else Effort()
    starts = options.starts or effort.trials.starts
    effort = replace(effort, budget=options.budget or effort.budget, trials=replace(effort.trials, starts=starts))
    return Plan(Space(scene, chosen_variables(tuple(fixed), varied)), options.objective,
                Reading(options.power, options.direction), options.least_speed, options.most_air, effort, options.seed)


def sought(scene: Scene) -> Scene:
    """`scene` with its motor turning from the start, and without what costs time and changes nothing."""
    return running(scene).with_parameters({"solver.audit": False})


def files_of(result: Result, candidates: Candidates) -> dict[str, bytes]:
    """Text, scene, numbers and pictures of a result, by the names of their files."""
    head = title(result.plan)
    pictures = {"convergence.png": draw_convergence(result.plan, candidates, head),
                "sensitivity.png": draw_sensitivity(result.around, head)}
    if result.front:
        pictures["front.png"] = draw_front(result, candidates, head)
    return {TEXT: document(result).encode(), SCENE: scene_file(result.robot, f"{head}; found by `study optimise`."),
            NUMBERS: result_file(result), **{name: png(figure) for name, figure in pictures.items()}}


def _fixed(words: Sequence[str]) -> dict[str, float | None]:
    """Names that are fixed, and the values that they are fixed at; None for the scene's."""
    found: dict[str, float | None] = {}
    for word in words:
        name, equals, value = word.partition("=")
        parameter = parameter_named(name, BY_NAME)
        found[name] = parameter.checked(_number("--fix", word, value)) if equals else None
    return found


def _varied(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    found = {}
    for word in words:
        if not (parts := _VARIED.fullmatch(word)):
            raise ValueError(f"--vary {word}: give NAME=LOW:HIGH, such as crank.radius=0.01:0.03")
        found[parts[1]] = _number("--vary", word, parts[2]), _number("--vary", word, parts[3])
    return found


def _number(option: str, word: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{option} {word}: {text!r} is not a number") from None


def parser() -> Parser:
    """The command line of the study."""
    default = Effort()
    own = study_parser(
        "optimise", "Search for the fastest or thriftiest robot, verify the optimum from fresh starts and beside the "
        "paper's, perturb it, and write text, pictures and a scene file.", "a run failed")
    own.add_argument("--scene", default="device", metavar="NAME", help="shipped scene or scene file that gives "
                        "everything that is not varied (default: %(default)s)")
    objectives = "; ".join(f"{name}: {one.does}" for name, one in OBJECTIVES.items())
    own.add_argument("--objective", choices=[*OBJECTIVES, FRONT], default="speed_per_power", help=f"{objectives}; "
                        f"{FRONT}: speed and cost of transport (default: %(default)s)")
    own.add_argument("--power", choices=POWERS, default="net", help="what P is; net: less what springs return to "
                        "the motor; delivered: without that (default: %(default)s)")
    own.add_argument("--direction", choices=DIRECTIONS, default="either", help="which way counts; all starts must "
                        "agree (default: %(default)s)")
    own.add_argument("--least-speed", type=float, default=0.0, metavar="V", help="slower robots do not count [m/s] "
                        "(default: %(default)s)")
    own.add_argument("--most-air", type=float, default=1.0, metavar="SHARE", help="robots that are in the air for "
                        "a larger share of the time do not count (default: %(default)s)")
    own.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="another value of the scene, "
                        "such as start.state=zero")
    own.add_argument("--fix", action="append", default=[], metavar="NAME[=VALUE]", help="do not vary this parameter")
    own.add_argument("--vary", action="append", default=[], metavar="NAME=LOW:HIGH", help="vary it between these "
                        "bounds, in its unit")
    own.add_argument("--budget", type=int, metavar="N", help=f"robots that are tried (default: {default.budget})")
    own.add_argument("--starts", type=int, metavar="N", help="drawn starts of each robot (default: "
                        f"{default.trials.starts})")
    own.add_argument("--seed", type=int, default=0, metavar="N", help="of the search (default: %(default)s)")
    add_execution(own)
    own.add_argument("--quick", action="store_true", help="a look at everything within two minutes, not an optimum")
    return own

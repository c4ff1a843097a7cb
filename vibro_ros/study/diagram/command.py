"""``study diagram``: the states once a turn over a parameter, swept up and down, and what kind of motion they are."""

import argparse
from collections.abc import Sequence

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import PREFIX, Scene
from vibro_ros.orbits.turn_map import TURN, coordinates, free_cut
from vibro_ros.process.entry_point import Parser
from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.study.command import (
    add_execution,
    add_machine,
    execution_of,
    locked,
    machine_of,
    run_study,
    study_parser,
    write_files,
)
from vibro_ros.study.diagram.result import Diagram, draw_diagram, in_words, states_table, values_table
from vibro_ros.study.diagram.visits import Design, measured, visited
from vibro_ros.study.variation import Axis, varied_in_words

VISITS, NATURES = "visits", "natures"
STATES, VALUES, PICTURE = "states.parquet", "values.parquet", "diagram.png"
_SCENE, _VARY, _COUNT, _QUICK_COUNT = "device", "motor.speed=60:240", 181, 31
_MOST_TURNS, _EXPONENTS, _CUTS = 4096, 100, 1000


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return run_study(_diagram, _parser(), words)


def _diagram(options: argparse.Namespace) -> int:
    execution = execution_of(options)
    design = _design(options, machine_of(options), _axis(options))
    with locked(options.output):
        for name in (VISITS, NATURES):
            (options.output / name).mkdir(exist_ok=True)
        states, seen = visited(design, options.output / VISITS)
        natures = (measured(design, seen, options.output / NATURES, execution) if design.exponents or design.cuts else
                   None)
        found = Diagram(design, seen, natures)
        write_files(options.output, {STATES: states_table(design, states), VALUES: values_table(found),
                                     PICTURE: draw_diagram(found)})
    print("\n".join(in_words(found)))
    return 0


def _axis(options: argparse.Namespace) -> Axis:
    """The parameter that varies, and its values, ascending."""
    default = f"{_VARY}:{_QUICK_COUNT if options.quick else _COUNT}"
    name, axis = varied_in_words(options.vary or default)
    if not isinstance(axis, Axis):
        raise ValueError(f"--vary {options.vary}: a range needs a count here; give NAME=LOW:HIGH:COUNT")
    if name.startswith(PREFIX) or name.startswith("solver."):
        raise ValueError(f"--vary {name}: is no part of the machine, whose motions would stay the same; choose another")
    if not isinstance(BY_NAME[name].default, float):
        raise ValueError(f"--vary {name}: is {BY_NAME[name].type_name}; choose a number, which can go up and down")
    if len(axis.values) < 2:
        raise ValueError(f"--vary {options.vary}: one value goes neither up nor down; give at least 2")
    return Axis(name, tuple(sorted(axis.values)))


def _design(options: argparse.Namespace, scene: Scene, axis: Axis) -> Design:
    """The design; the cut is that of the first value unless it is given."""
    first = scene.with_parameters({axis.name: axis.values[0]})
    prepare_kernels("study", scene["solver.method"])
    if options.phase is None:
        phase = float(free_cut(first).phase)
    elif 0.0 <= options.phase < TURN:
        phase = options.phase
    else:
        raise ValueError(f"--phase: {options.phase:g} is out of range; give a number from 0 to 6.28318 rad")
    names = coordinates(first)
    if not names:
        raise ValueError(f"{scene.name}: has no mass whose motion could be shown; give one with effects.upper_mass")
    return Design(scene, axis, phase, options.coordinate or names[-1 if len(names) < 4 else 3], options.most_turns,
                  options.exponents, options.cuts)


def _parser() -> Parser:
    parser = study_parser(
        "diagram", "Sweep a parameter up and down, each value beginning where the one before has ended; show the "
        "states once a turn, where the two ways lead to two motions, all Lyapunov exponents and the 0-1 test. Writes "
        "two Parquet files and a picture.")
    add_machine(parser, _SCENE)
    parser.add_argument("--vary", metavar="NAME=VALUES", help="LOW:HIGH:COUNT, a grid; A,B,C, a list; `:log` behind a "
                        f"grid spreads it by its logarithm (default: {_VARY}:{_COUNT})")
    parser.add_argument("--coordinate", metavar="NAME", help="of the state, in the picture and for the 0-1 test "
                        "(default: inclined_velocity, or the last there is)")
    parser.add_argument("--phase", type=float, metavar="RAD", help="crank angle at which the states are seen (default: "
                        "where nothing touches at the first value)")
    parser.add_argument("--most-turns", type=int, default=_MOST_TURNS, metavar="N", help="turns of the crank that a "
                        "motion has to settle (default: %(default)d)")
    parser.add_argument("--exponents", type=int, default=_EXPONENTS, metavar="TURNS", help="turns over which the "
                        "exponents of a motion that is not periodic are measured, up to 16 times as many until the "
                        "sign of the largest is known; 0: no exponents (default: %(default)d)")
    parser.add_argument("--cuts", type=int, default=_CUTS, metavar="TURNS", help="turns that the 0-1 test hears; 0: no "
                        "test (default: %(default)d)")
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK_COUNT} values, where these are not given")
    add_execution(parser)
    return parser

"""The `replay` executable: a recorded run computed again, compared, changed, or played to ROS."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("replay"))

import argparse
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

from vibro_ros.bag.stream import BagError, BagStream, not_read
from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import Parser, exit_code, say
from vibro_ros.process.untrusted import one_line
from vibro_ros.recordings.comparison import Comparison, compare
from vibro_ros.recordings.summary import as_text, load_samples, summarise
from vibro_ros.recordings.variation import write_variation

IDENTICAL, DIFFERENT = 0, 1
"""Exit codes; a changed run that was written is `IDENTICAL`, one that could not go on is `DIFFERENT`."""
PLAYBACK = "vibro_ros.ros.controller.playback"
"""Module that plays a bag to ROS; named only, because nothing else here needs ROS."""
OF_PUBLISH = ("--all-topics", "--rate", "--clock", "--wait", "--ros-args")
"""Options that only `PLAYBACK` has."""


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("replay", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    check_combination(words)
    if "--publish" in words:
        return import_module(PLAYBACK).main([word for word in words if word != "--publish"])
    options = _parser().parse_args(words)
    try:
        return _vary(options.bag, _changes(options.set)) if options.set else _compare(options.bag)
    except BagError as error:
        raise ValueError(str(error)) from error
    except OSError as error:
        raise ValueError(f"{error.filename or options.bag}: {error.strerror or error}") from error
    except MemoryError:
        raise ValueError(f"{options.bag}: not enough memory to read it") from None


def check_combination(words: Sequence[str]) -> None:
    """Refuse options that do nothing together.

    Raises
    ------
    ValueError
        Naming the option and the remedy.
    """
    options = {word.partition("=")[0]: word for word in words if word.startswith("--")}
    if "--publish" in options and "--set" in options:
        raise ValueError("--set: simulates the run again, and --publish plays what was recorded; give one of the two")
    alone = [word for option, word in options.items() if option in OF_PUBLISH]
    if alone and "--publish" not in options:
        raise ValueError(f"{alone[0]}: is for playing the bag to ROS; add --publish, or leave {alone[0]} out")


def _compare(bag: Path) -> int:
    with BagStream(bag) as stream:
        found = compare(stream)
        flaws = stream.flaws
    if not found.compared and not found.difference:
        raise BagError(f"{bag}: holds no state to compare with; give a bag with odom or joint_states")
    print("\n".join([*map(one_line, described(found)), *not_read(flaws)]))
    return DIFFERENT if found.difference else IDENTICAL


def described(found: Comparison) -> list[str]:
    """A comparison, in lines for people."""
    lines = [f"{'different' if found.difference else 'identical'}: {sum(found.compared.values())} messages to "
             f"{found.last:.3f} s of robot time, {found.commands} commands"]
    if found.difference:
        lines[0] = f"different after {lines[0].removeprefix('different: ')}"
        lines.append(f"first difference: {found.difference}")
    if found.missing:
        lines.append(f"not recorded: {found.missing} messages, not compared")
    if found.difference:
        lines += [f"note: {note}" for note in found.notes]
    return lines


def _vary(bag: Path, changes: Mapping[str, object]) -> int:
    """Compute the run again with other parameters, into a new bag."""
    folder, failure = write_variation(bag, changes)
    for title, one in (("recorded", bag), ("replayed with " + _shown(changes), folder)):
        print(f"{title}:\n{_summary(one)}")
    print(one_line(folder))
    if failure:
        say("replay", failure)
    return DIFFERENT if failure else IDENTICAL


def _summary(bag: Path) -> str:
    try:
        return as_text(summarise(load_samples(bag)))
    except BagError as error:
        return f"no summary: {error}\n"


def _shown(changes: Mapping[str, object]) -> str:
    return ", ".join(f"{name}={value}" for name, value in changes.items())


def _changes(texts: Sequence[str]) -> dict[str, object]:
    """Names and values of several `name=value`."""
    changes: dict[str, object] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals):
            raise ValueError(f"--set {text}: not a change; write name=value, such as guide.angle=1.2")
        if name in changes:
            raise ValueError(f"--set {text}: {name} is set already, to {changes[name]}; give one of the two")
        changes[name] = read_scalar(value)
    return changes


def _parser() -> Parser:
    parser = Parser(
        prog="replay", allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter,
        description=EXECUTABLES["replay"].does,
        epilog="With --set, the recorded commands drive a robot with other parameters, whose bag is written.\n"
        "With --publish, the bag is played on the live graph: `replay --publish --help`.\n\n"
        "Exit code 0: identical (with --set: written); 1: different, the first difference is named (with --set: the\n"
        "simulation could not go on); 2: no bag of the robot, or a bad parameter; 129, 130, 143: stopped by SIGHUP,\n"
        "SIGINT, SIGTERM.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of a recording, sealed")
    parser.add_argument("--set", action="append", metavar="NAME=VALUE",
                        help="change a parameter of the scene, such as guide.angle=1.2, and write what the robot would "
                        "have done to a new bag beside the recording; repeatable")
    parser.add_argument("--publish", action="store_true", help="play the bag's commands to ROS")
    return parser

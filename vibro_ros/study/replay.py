"""The `replay` executable: a recorded run computed again, compared, changed, or played to ROS."""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from vibro_ros.bag.reader import load_bag
from vibro_ros.bag.stream import BagError, BagStream
from vibro_ros.one_line import one_line
from vibro_ros.strict_yaml import read_scalar
from vibro_ros.study.comparison import Comparison, compare
from vibro_ros.study.report import COLUMNS
from vibro_ros.study.summary import as_text, not_read, summarise
from vibro_ros.study.variation import write_variation

IDENTICAL, DIFFERENT, BAD_INPUT = 0, 1, 2
"""Exit codes; a changed run that was written is `IDENTICAL`, one that could not go on is `DIFFERENT`."""
PLAYBACK = "vibro_ros.ros.playback"
"""Module that plays a bag to ROS: a process of its own, because nothing here needs ROS."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the executable; returns its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "--publish" in words:
        words.remove("--publish")
        os.execv(sys.executable, [sys.executable, "-m", PLAYBACK, *words])
    options = _parser().parse_args(words)
    try:
        if options.set:
            return _vary(options.bag, dict(_change(text) for text in options.set))
        return _compare(options.bag)
    except (BagError, ValueError) as error:
        return _failed(str(error), BAD_INPUT)
    except OSError as error:
        return _failed(f"{error.filename or options.bag}: {error.strerror or error}", BAD_INPUT)
    except MemoryError:
        return _failed(f"{options.bag}: not enough memory to read it", BAD_INPUT)


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
    return _failed(failure, DIFFERENT) if failure else IDENTICAL


def _summary(bag: Path) -> str:
    try:
        return as_text(summarise(load_bag(bag, COLUMNS)))
    except BagError as error:
        return f"no summary: {error}\n"


def _shown(changes: Mapping[str, object]) -> str:
    return ", ".join(f"{name}={value}" for name, value in changes.items())


def _change(text: str) -> tuple[str, object]:
    """Name and value of `name=value`."""
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set {text}: not a change; write name=value")
    return name, read_scalar(value)


def _failed(reason: str, code: int) -> int:
    print(f"replay: {one_line(reason)}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="replay", allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Simulate a recorded run again from its commands and compare every recorded number, to the last\n"
        "bit; or tell what it would have done with other parameters; or play the bag to ROS.",
        epilog="With --publish, the bag is played on the live graph: `replay --publish --help`.\n\n"
        "Exit code 0: identical (with --set: written); 1: different, the first difference is named (with --set: the\n"
        "simulation could not go on); 2: no bag of the robot, or a bad parameter.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of a recording, sealed")
    parser.add_argument("--set", action="append", metavar="NAME=VALUE",
                        help="change a parameter of the scene, such as guide.angle=1.2, and write what the robot would "
                        "have done to a new bag beside the recording; repeatable")
    parser.add_argument("--publish", action="store_true", help="play the bag's commands to ROS")
    return parser


if __name__ == "__main__":
    sys.exit(main())

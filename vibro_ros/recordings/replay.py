"""The `replay` executable: simulates a recorded run again, and compares it, or changes its parameters."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    from vibro_ros.process.entry_point import enter

    raise SystemExit(enter("replay"))

import argparse
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, count
from pathlib import Path

from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.recorder import BagWriter, Storage
from vibro_ros.bag.stream import BagError, BagStream, bag_errors, flaw_lines
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.configuration.strict_yaml import read_settings
from vibro_ros.messages.topics import CHECKPOINT, COMMAND_UNITS, INPUTS, OF_DC_MOTOR, SENSOR_TOPICS, TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import Parser, exit_code, say
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.files import one_line
from vibro_ros.recordings.comparison import Comparison, compare
from vibro_ros.recordings.rerun import SAMPLED, RecordedRun, Rerun, recorded_run
from vibro_ros.recordings.summary import differences_as_text, load_samples, summarise
from vibro_ros.sensors.device import sensors_on
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.provenance import provenance

IDENTICAL, DIFFERENT = 0, 1
"""Exit codes; with --set, `IDENTICAL` means that the run was written, `DIFFERENT` that it could not go on."""


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("replay", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    with bag_errors(options.bag):
        return _show_what_if(options.bag, read_settings(options.set)) if options.set else _compare(options.bag)


def _compare(bag: Path) -> int:
    with BagStream(bag) as stream:
        comparison = compare(stream)
        flaws = stream.flaws
        if comparison.difference and comparison.run.lacks_beginning:
            late = (stream.start - comparison.run.start) * 1e-9
            raise BagError(f"{bag}: cannot be replayed: it begins {late:.3f} s after the robot's start and holds no "
                           "checkpoint, so that what the robot received before is unknown; give a bag of the run's "
                           "beginning, or one with ~/checkpoint")
    if not comparison.compared and not comparison.difference:
        raise BagError(f"{bag}: holds no state to compare with; give a bag with odom or joint_states")
    print("\n".join([*map(one_line, comparison_lines(comparison)), *flaw_lines(flaws)]))
    return DIFFERENT if comparison.difference else IDENTICAL


def comparison_lines(comparison: Comparison) -> list[str]:
    """Return the lines for people on a comparison."""
    verdict = "different" if comparison.difference else "identical"
    lines = [f"{verdict}: {sum(comparison.compared.values())} messages to "
             f"{comparison.last:.3f} s of robot time, {comparison.commands} commands"]
    if comparison.difference:
        lines[0] = f"different after {lines[0].removeprefix('different: ')}"
        lines.append(f"first difference: {comparison.difference}")
    if comparison.missing:
        lines.append(f"not recorded: {comparison.missing} messages, not compared")
    if comparison.difference:
        lines += [f"note: {note}" for note in comparison.notes]
    return lines


def _show_what_if(bag: Path, changes: Mapping[str, object]) -> int:
    """Simulate the run with other parameters into a new bag, and print in which numbers the two bags differ."""
    folder, failure = what_if(bag, changes)
    try:
        print(differences_as_text(*(summarise(load_samples(folder_of_bag)) for folder_of_bag in (bag, folder))))
    except BagError as error:
        print(f"no differences: {error}")
    print(one_line(folder))
    if failure:
        say("replay", failure)
    return DIFFERENT if failure else IDENTICAL


def what_if(bag: Path, changes: Mapping[str, object]) -> tuple[Path, str]:
    """Simulate a recorded run with `changes` to its scene, from its start to its last message, into a new bag.

    The new bag is ``<bag>_replay`` beside the recording, with ``_2``, ``_3``, … where taken. Returns its folder, and
    why the simulation could not go on to the end; empty when it could. BagError when the recording cannot be read, or
    does not say what was simulated; ValueError for a bad change; OSError when the new bag cannot be written.
    """
    _refuse_parameters_of_node(changes)
    with BagStream(bag) as stream:
        run = recorded_run(stream)
        scene = run.scene.with_parameters(changes)
        run = replace(run, topics=_sensor_topics(run, scene) | run.topics)
        if run.begins_late:
            raise BagError(f"{bag}: begins {(stream.start - run.start) * 1e-9:.3f} s after the robot started, and "
                           "what another would have done until then is unknown; give a bag of the run's beginning")
        rerun = Rerun(run, scene)
        topics = _topics(stream, run)
        original = stream.folder.resolve()
        custom = {"scene": rerun.scene.name, "topics": json.dumps(run.topics),
                  **provenance({**run.settings, **rerun.scene.parameters}, run.start),
                  "replay_of": original.name, "changes": json.dumps(dict(changes))}
        writer = BagWriter(_free_folder(original), defined([*topics.values()]), custom, Storage())
        writer.latch([(topics[name].name, data) for name, data in rerun.latched.items() if name in topics])
        try:
            for _, recorded in rerun.through(stream):
                inputs = [(name, data) for name, data in recorded if name in INPUTS]
                for name, data in (*rerun.published(), *inputs):
                    writer.write(run.topics[name], run.stamp(rerun.tick), data)
            return writer.folder, ""
        except SimulationError as error:
            return writer.folder, str(error)
        finally:
            writer.flush()
            writer.close({"written": str(writer.stored), "dropped": "0", "lost": "0"})


def _refuse_parameters_of_node(changes: Mapping[str, object]) -> None:
    """Refuse changes that are not of the scene: commands are replayed by sample, so that the node's rate is fixed."""
    of_node = {parameter.name for parameter in DEVICE_PARAMETERS}
    for name, value in changes.items():
        if name in of_node:
            raise ValueError(f"{name}={value}: is a parameter of the node, which the recording fixes; change one of "
                             f"the scene, such as guide.angle=1.2, or record again with -p {name}:={value}")


def _free_folder(original: Path) -> Path:
    """Return a folder that does not exist, beside the bag `original` and named after it."""
    suffixes = chain([""], (f"_{number}" for number in count(2)))
    folders = (original.with_name(f"{original.name}_replay{suffix}") for suffix in suffixes)
    return next(folder for folder in folders if not os.path.lexists(folder))


def _topics(stream: BagStream, run: RecordedRun) -> dict[str, Topic]:
    """Return the topics of the new bag: those of the recorded robot, with their recorded names."""
    names = run.topics
    if missing := [name for name in (*SAMPLED, "impacts", *COMMAND_UNITS)
                   if name not in names and name not in OF_DC_MOTOR]:
        raise BagError(f"{stream.folder}: says nothing of the topics {', '.join(missing)}; give a bag that the robot "
                       "recorded itself")
    return {name: Topic(names[name], topic.type, topic.quality.depth, topic.quality.transient_local)
            for name, topic in TOPICS.items()  # of a dc motor only where there is one
            if name in names and name != CHECKPOINT}


def _sensor_topics(run: RecordedRun, scene: Scene) -> dict[str, str]:
    """Return names for the topics of a scene's sensors, which the recorded robot may lack; with the prefix of odom."""
    names = [SENSOR_TOPICS[sensor] for sensor in sensors_on(scene)]
    return {name: f"{run.topics['odom'].removesuffix('odom')}{name}" for name in names if "odom" in run.topics}


def _parser() -> Parser:
    parser = Parser(
        prog="replay", allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter,
        description=EXECUTABLES["replay"].does,
        epilog="With --set, the recorded commands drive a robot with other parameters, whose bag is written.\n"
        "`ros2 bag play` plays a bag to ROS.\n\n"
        "Exit code 0: identical (with --set: written); 1: different, the first difference is named (with --set: the\n"
        "simulation could not go on); 2: no bag that can be replayed, or a bad parameter; 129, 130, 143: stopped by\n"
        "SIGHUP, SIGINT, SIGTERM.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of a recording")
    parser.add_argument("--set", action="append", metavar="NAME=VALUE",
                        help="change a parameter of the scene, such as guide.angle=1.2, and write what the robot would "
                        "have done to a new bag beside the recording; repeatable")
    return parser

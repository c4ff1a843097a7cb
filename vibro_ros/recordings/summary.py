"""Summary of a recording in numbers: displacement, speed, impacts, power, gaps in the data."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.bag.reader import Arrays, Bag, BagError, load_bag, series_of
from vibro_ros.bag.stream import flaw_lines
from vibro_ros.messages.frames import JOINTS
from vibro_ros.messages.topics import OPERATIONS
from vibro_ros.model.parameters import BY_NAME, SCENE_PARAMETERS
from vibro_ros.model.scene import Scene
from vibro_ros.process.files import one_line
from vibro_ros.recordings.energy import LOST, RECEIVED, RECEIVED_BY_DC, differences_between_resets, reset_times
from vibro_ros.recordings.rerun import SAMPLED
from vibro_ros.simulation.validity import GAP, Validity, validity_of

GUIDES = ("upper", "inclined")
JOINT_COLUMNS = ("crank.position", "crank.velocity")  # of every robot; masses and plates may be absent from a scene
COLUMNS = {"odom": ("position", "linear_velocity"), "joint_states": ("*.position", "*.velocity"),
           "ground_contact": ("force",), "impacts": ("stamp", "frame", "force"), "motor_power": ("value",),
           "motor_speed": ("value",), "upper_gap": ("value",), "inclined_gap": ("value",), "motor_current": ("value",),
           OPERATIONS: ("text",)}
"""Columns that summary and picture need, because a recording may be long; commands are read to find unreadable ones."""
MOST_OPERATIONS = 50  # most operations that a summary lists
LARGEST = 1e100
"""Largest magnitude of a number that is used: no machine has a larger one, and squares of larger ones overflow."""


def load_samples(folder: Path) -> Bag:
    """Read the columns of a recording that a report needs, without messages that no robot can have sent.

    Such messages, with numbers that are not finite or beyond `LARGEST`, are counted in the bag's flaws. BagError when
    the recording cannot be read.
    """
    bag = load_bag(folder, COLUMNS)
    arrays, flaws = {}, list(bag.flaws)
    for topic, columns in bag.arrays.items():
        columns = _shared(columns)
        sound = np.ones(len(columns["time"]), dtype=bool)
        for column in columns.values():
            if column.dtype.kind == "f":
                sound &= np.all(np.abs(column) <= LARGEST, axis=tuple(range(1, column.ndim)))
        arrays[topic] = {name: column[sound] for name, column in columns.items()}
        if unsound := np.count_nonzero(~sound):
            flaws.append(f"{topic}: {unsound} messages with numbers that are not finite, or beyond {LARGEST:g}")
    return replace(bag, arrays=arrays, flaws=tuple(flaws))


def _shared(columns: Arrays) -> Arrays:
    """Return a topic's columns at the instants that all joints of a robot share, without other robots' joints."""
    common, *parts = series_of(columns)
    if not parts:
        return columns
    parts = [part for part in (common, *parts) if any(name.rpartition(".")[0] in JOINTS for name in part)]
    shared: Arrays = {"time": reduce(np.intersect1d, [part["time"] for part in parts] or [common["time"]])}
    for part in parts:
        rows = np.searchsorted(part["time"], shared["time"])
        shared = {name: column[rows] for name, column in part.items()} | shared
    return shared


def summarise(bag: Bag) -> dict[str, Any]:
    """Summarise a recording, ready for JSON; a number that is not defined is None.

    BagError when a topic or a joint of the robot is missing, or odometry, joint states or motor power is empty.

    Returns
    -------
    dict
        ``duration`` [s] from the first message to the last; ``resets``, the number of resets to the start;
        ``operations``, the first `MOST_OPERATIONS` operations, each a time [s] and the text of
        `messages.operations.Operation`; ``displacement`` [m] of the body from its first sample to its last, without the
        jumps of resets, ``path_length`` [m] of the path between them, ``mean_speed`` [m/s], displacement over time;
        ``crank_turns``; ``impacts`` and ``impacts_per_turn`` of each guide; ``mean_power`` [W] over time; ``load``,
        from the samples of the normal force N: ``mean``, their mean over the weight, None if the bag does not state the
        masses, and ``unloaded``, the share of samples with N not above 0; ``validity``, the fields of `Validity`, None
        also if the bag does not state the robot's parameters; ``recorder``, the bag's custom data; ``topics``: type and
        ``messages`` of each, and for sampled topics ``period`` [s] (median), ``largest_gap`` [s] and ``gaps`` (number
        of pauses above `GAP` periods); ``flaw_lines``, sentences on the parts of the recording that cannot be read.
    """
    body, joints, power = (_samples(bag, name) for name in ("odom", "joint_states", "motor_power"))
    if lacking := [name for name in JOINT_COLUMNS if name not in joints]:
        raise BagError(f"{bag.path}: {bag.full_name('joint_states')} lacks {', '.join(lacking)}; "
                       "report on a recording of this package's robot")
    scene, resets, normal = _scene(bag.metadata), reset_times(joints), bag["ground_contact"]["force"][:, 2]
    steps = differences_between_resets(body["time"], body["position"][:, 0], resets)
    turns = float(differences_between_resets(joints["time"], joints["crank.position"], resets).sum()) / math.tau
    impacts = {guide: int(np.count_nonzero(impacts_of(bag, guide))) for guide in GUIDES}
    return {
        "bag": str(bag.path),
        "duration": bag.duration,
        "resets": len(resets),
        "operations": _operations(bag),
        "displacement": float(steps.sum()),
        "path_length": float(np.abs(steps).sum()),
        "mean_speed": _ratio(float(steps.sum()), float(np.ptp(body["time"]))),
        "crank_turns": turns,
        "impacts": impacts,
        "impacts_per_turn": {guide: _ratio(number, turns) for guide, number in impacts.items()},
        "mean_power": _ratio(float(np.diff(power["time"]) @ (power["value"][1:] + power["value"][:-1])) / 2,
                             float(np.ptp(power["time"]))),
        "load": {"mean": _ratio(float(np.mean(normal)), scene.total_mass * scene.gravity[1])
                 if scene and len(normal) else None,
                 "unloaded": float(np.mean(normal <= 0.0)) if len(normal) else None},
        "validity": _validity(scene, bag)._asdict(),
        "recorder": bag.metadata,
        "topics": {topic: _topic_summary(bag, topic) for topic in bag.topics},
        "not_read": list(bag.flaws),
    }


def _scene(recorder: dict[str, str]) -> Scene | None:
    """Return the robot's scene from the bag's custom data; missing parameters get their defaults. None without any."""
    known = {parameter.name for parameter in SCENE_PARAMETERS}
    given = {name: value for name, value in _parameters(recorder).items() if name in known}
    try:
        return Scene("", given) if given else None
    except (ValueError, TypeError):
        return None


def _validity(scene: Scene | None, bag: Bag) -> Validity:
    """Return the validity of the model's simplifications, from the samples common to odometry and joint states."""
    body, joints = bag["odom"], bag["joint_states"]
    if not scene or not {f"{side}_mass.position" for side in scene.guides} <= joints.keys():
        return Validity(None, None)
    time, of_body, of_joints = np.intersect1d(body["time"], joints["time"], return_indices=True)
    samples = {"time": time, "body_height": body["position"][of_body, 2],
               "body_vertical_velocity": body["linear_velocity"][of_body, 2],
               **{f"{side}_{quantity}": joints[f"{side}_mass.{quantity}"][of_joints]
                  for side in scene.guides for quantity in ("position", "velocity")}}
    current = {"motor_current": bag["motor_current"]["value"]} if "motor_current" in bag else {}
    return validity_of(scene, samples | current)


def _operations(bag: Bag) -> list[tuple[float, str]]:
    if OPERATIONS not in bag:
        return []
    operations = bag[OPERATIONS]
    return [(float(time), str(text)) for time, text in zip(operations["time"][:MOST_OPERATIONS],
                                                           operations["text"][:MOST_OPERATIONS], strict=True)]


def impacts_of(bag: Bag, guide: str) -> np.ndarray:
    """Return which recorded impacts belong to `guide`, by their frame: bool, shape (n,)."""
    return np.char.endswith(bag["impacts"]["frame"], f"{guide}_plate")  # the robot's frame_prefix comes first


class Number(NamedTuple):
    """A number of a summary: `value` gets it from the summary (None if undefined), the rest formats it for people."""

    value: Callable[[dict[str, Any]], float | None]
    form: str
    unit: str = ""
    scale: float = 1.0

    def of(self, summary: dict[str, Any]) -> float | None:
        """Return the number in its unit."""
        value = self.value(summary)
        return None if value is None else value * self.scale

    def text(self, summary: dict[str, Any]) -> str:
        """Return the number as text, with its unit."""
        value = self.of(summary)
        return "-" if value is None else f"{value:{self.form}} {self.unit}".rstrip()


def _nested(part: str, name: str) -> Callable[[dict[str, Any]], float | None]:
    return lambda summary: summary[part][name]


NUMBERS: Mapping[str, Number] = {
    "duration": Number(itemgetter("duration"), ".3f", "s"),
    "resets": Number(itemgetter("resets"), ".0f"),  # the jumps of resets do not count below
    "displacement": Number(itemgetter("displacement"), "+.4f", "m"),
    "path": Number(itemgetter("path_length"), ".4f", "m"),
    "mean speed": Number(itemgetter("mean_speed"), "+.2f", "mm/s", 1e3),
    "crank turns": Number(itemgetter("crank_turns"), ".1f"),
    **{f"{guide} impacts": Number(_nested("impacts", guide), ".0f") for guide in GUIDES},
    **{f"{guide} impacts per turn": Number(_nested("impacts_per_turn", guide), ".2f")
       for guide in GUIDES},
    "mean power": Number(itemgetter("mean_power"), ".3f", "W"),
    "mean N / weight": Number(_nested("load", "mean"), ".3f"),  # landings' shocks lie between samples
    "samples with N <= 0": Number(_nested("load", "unloaded"), ".1f", "%", 1e2),
    "pitch index": Number(_nested("validity", "pitch_index"), ".3f"),
    "rms / continuous current": Number(_nested("validity", "current_share"), ".3f"),
}
"""Numbers in the text of a recording, the table of a replay's differences, and the caption, by label."""
CAPTION = ("duration", "displacement", "mean speed", *(f"{guide} impacts per turn" for guide in GUIDES), "mean power")


def as_text(summary: dict[str, Any]) -> str:
    """Return the summary as text with units, and with the accounts in ``energy``, the result of `energy_of`, if any."""
    lines = [("bag", summary["bag"]),
             *((one_line(key), one_line(value)) for key, value in summary["recorder"].items() if len(value) < 80),
             *((label, number.text(summary)) for label, number in NUMBERS.items()),
             *(("warning", warning) for warning in Validity(**summary["validity"]).warnings())]
    width = max(len(label) for label, _ in lines) + 2
    energy = ["", *energy_as_lines(summary["energy"])] if "energy" in summary else []
    operations = [f"{time:>10.3f} s  {one_line(text)}" for time, text in summary["operations"]]
    if operations:
        operations = ["", "what was done to the run", *operations]
    return "\n".join([*(f"{label:<{width}}{value}" for label, value in lines), *energy, *operations, "",
                      *_table(summary["topics"]), *flaw_lines(summary["not_read"])]) + "\n"


def differences_as_text(recorded: dict[str, Any], replayed: dict[str, Any]) -> str:
    """Return the scene's parameters and the numbers in which a replay with changes differs, as one table."""
    given, changed = (_parameters(summary["recorder"]) for summary in (recorded, replayed))
    rows = [(name, _shown(given.get(name)), _shown(changed.get(name)), "") for name in sorted(BY_NAME)
            if given.get(name) != changed.get(name)]
    for label, number in NUMBERS.items():
        value, other = number.of(recorded), number.of(replayed)
        shown, shown_other = ("-" if quantity is None else f"{quantity:.6g}" for quantity in (value, other))
        if shown != shown_other:
            difference = "-" if value is None or other is None else f"{other - value:+.6g}"
            rows.append((f"{label} [{number.unit}]" if number.unit else label, shown, shown_other, difference))
    return "\n".join(aligned([("", "recorded", "replayed", "difference"), *rows]))


def _parameters(recorder: dict[str, str]) -> dict[str, Any]:
    """Return the recorded parameters; empty if the recording does not state them."""
    try:
        parameters = json.loads(recorder.get("parameters", "{}"))
    except (ValueError, RecursionError):
        return {}
    return parameters if isinstance(parameters, dict) else {}


def _shown(value: object) -> str:
    return "-" if value is None else one_line(value)


def as_caption(summary: dict[str, Any]) -> str:
    """Return the summary in one line, for a picture."""
    return "  ·  ".join(f"{label} {NUMBERS[label].text(summary)}" for label in CAPTION).replace(
        " -", " \N{MINUS SIGN}")


def _table(topics: dict[str, dict[str, Any]]) -> list[str]:
    columns = (Number(itemgetter("messages"), ".0f"), Number(lambda topic: topic.get("period"), ".2f", "ms", 1e3),
               Number(lambda topic: topic.get("largest_gap"), ".2f", "ms", 1e3),
               Number(lambda topic: topic.get("gaps"), ".0f"))
    return aligned([("topic", "messages", "period", "largest gap", "gaps"),
                    *((one_line(name), *(column.text(topic) for column in columns)) for name, topic in topics.items())])


def energy_as_lines(energy: dict[str, Any]) -> list[str]:
    """Return the accounts as a table: energy, and its share of what the motor, or its supply, delivered."""
    if "unknown" in energy:
        return [f"energy: unknown: {energy['unknown']}"]
    accounts = energy["accounts"]
    received, giver = (RECEIVED_BY_DC, "supply") if "supply" in accounts else (RECEIVED, "motor")
    full = accounts["supply" if giver == "supply" else "motor_delivered"]
    rows = []
    for name, sign in {**received, **dict.fromkeys((*LOST, "stored", "residual"), -1.0)}.items():
        amount = sign * accounts.get(name, 0.0)
        if amount or name in ("motor_delivered", "supply", "stored"):
            rows.append((name.replace("_", " "), f"{amount:+.6g} J", f"{amount / full:+.2%}" if full else ""))
    power, cost = ("-" if energy[name] is None else format(energy[name], ".5g") for name in (
        "mean_power", "cost_of_transport"))
    return [f"energy over {energy['duration']:.3f} s, from the run simulated again: + received, - lost or stored; "
            f"shares of what the {giver} delivered", *aligned(rows),
            f"net power of the {giver} {power} W; cost of transport {cost}, its net work over weight times "
            "displacement"]


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows of a table as lines: the first column aligned left, the others right."""
    first, *others = ([*column] for column in zip(*rows, strict=True))
    columns = [[text.ljust(max(map(len, first))) for text in first],
               *([text.rjust(max(map(len, column))) for text in column] for column in others)]
    return ["  ".join(row).rstrip() for row in zip(*columns, strict=True)]


def _topic_summary(bag: Bag, topic: str) -> dict[str, Any]:
    recorded = bag.topics[topic]
    summary = {"type": recorded.type_name, "messages": recorded.messages}
    if topic.rpartition("/")[2] not in SAMPLED or topic not in bag:
        return summary
    pauses = np.diff(bag[topic]["time"])
    if not len(pauses):
        return summary | {"period": None, "largest_gap": None, "gaps": 0}
    period = float(np.median(pauses))
    return summary | {"period": period, "largest_gap": float(pauses.max()),
                      "gaps": int(np.count_nonzero(pauses > GAP * period))}


def _samples(bag: Bag, name: str) -> Arrays:
    arrays = bag[name]
    if not len(arrays["time"]):
        raise BagError(f"{bag.path}: {bag.full_name(name)} holds no message; record a robot that runs")
    return arrays


def _ratio(numerator: float, denominator: float) -> float | None:
    return numerator / denominator if denominator else None

"""The `view` executable for a recording, which it writes as one HTML file; `ros.live.view` shows a live robot.

The file has the motion at every instant, not only when the robot published. The recording of a robot's own recorder is
simulated again from its commands. The motion is exact wherever the simulation passes through the recorded positions;
the rest, and the recording of another recorder, is interpolated between the samples, and marked so.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    from vibro_ros.process.entry_point import enter

    raise SystemExit(enter("view"))

import argparse
import math
import webbrowser
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from vibro_ros.bag.reader import Arrays
from vibro_ros.bag.stream import BagError, BagStream, bag_errors
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.operations import PUSH, RESET, read_operation
from vibro_ros.messages.topics import OPERATIONS, TOPICS
from vibro_ros.model.faults import DURATION, FORCE
from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import Parser, exit_code, say
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.files import one_line, open_to_read, replace_file, user_path
from vibro_ros.recordings.comparison import notes
from vibro_ros.recordings.rerun import RecordedRun, Rerun, recorded_run
from vibro_ros.view.exact import ExactMotion, inexact_spans, spans
from vibro_ros.view.motion import (
    ExactInterval,
    Impact,
    Progress,
    Span,
    fitted_motion,
    impacts_as_json,
    is_position,
    without_tolerance_warning,
)
from vibro_ros.view.page import MARK, page_text
from vibro_ros.view.protocol import drawing, shown_quantities
from vibro_ros.view.recorded import Input, Recorded, interpolate, reset_instants

_HEAD = 4096  # bytes at the beginning of a file in which a page has its mark


def main(words: Sequence[str]) -> int:
    """Write the page of a recording; returns the exit code. `entry_point.enter` starts `live_view` for a live robot."""
    return exit_code("view", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    with bag_errors(options.bag):
        path = write_page(options.bag, options.output, load_scene(options.scene) if options.scene else None)
        print(one_line(path))
    if options.open and not webbrowser.open(path.resolve().as_uri()):
        say("view", "no browser could be opened; open the file above")
    return 0


def write_page(bag_folder: Path, output: Path | None = None, scene: Scene | None = None) -> Path:
    """Write the page of a recording: one file that needs no network and no other file.

    `scene` is the robot's scene, for a recording that does not state it. Returns the page's path, by default ``<bag
    folder>_view.html`` beside the recording; nothing is ever written into the recording. BagError when the recording
    cannot be read, or states its scene although `scene` is given, or when `output` lies inside it, cannot be written,
    or is a file that `view` has not written; OSError when an existing `output` cannot be read.
    """
    folder = user_path(bag_folder).resolve()
    path = user_path(output).absolute() if output else folder.with_name(f"{folder.name}_view.html")
    if path.resolve().is_relative_to(folder):
        raise BagError(f"{path}: lies inside the recording, which is never written to; give another --output")
    if path.exists() or path.is_symlink():
        with open_to_read(path) as file:
            if MARK.encode() not in file.read(_HEAD):
                raise BagError(f"{path}: is there, and no page that `view` wrote; give another --output")
    with tqdm(total=1.0, desc="view", delay=1.0, disable=None, leave=False,
              bar_format="{desc}: {percentage:3.0f} %|{bar}| {elapsed}") as bar:
        parts, header, payload = bag_motion(folder, lambda share: bar.update(max(0.0, share - bar.n)), scene)
    text = page_text({**parts, "mode": "bag", "version": metadata.version("vibro_ros")}, (header, payload))
    try:
        replace_file(path, text.encode())
    except OSError as error:
        raise BagError(f"{path}: cannot write: {error.strerror or error}; give a writable --output") from None
    return path


def _parser() -> Parser:
    parser = Parser(
        prog="view", formatter_class=argparse.RawDescriptionHelpFormatter, description=EXECUTABLES["view"].does,
        usage="view BAG_FOLDER [--output FILE] [--scene NAME] [--open]\n"
        "       view [--robot NODE] [--address ADDRESS] [--port PORT] [--open] "
        "[--ros-args ...]",
        epilog="The first form writes a recording as one HTML file, which can be mailed and needs no network: the\n"
        "robot drawn to scale, charts, and slow motion from impact to impact, exact between the samples.\n\n"
        "The second form serves a page of a live robot, and prints its address: the same, with knobs and buttons.\n"
        "--robot names the robot's node (vibro_robot), --address and --port say where the page is served\n"
        "(127.0.0.1 and 8742; port 0: any that is free), --open opens the browser, in either form.\n\n"
        "Exit code 0: written, or, of a live view, ended by SIGINT, SIGTERM or SIGHUP; 1: the server failed; 2: no\n"
        "readable recording, nowhere to write, a bad argument, or the port is taken; 129, 130, 143: stopped by\n"
        "SIGHUP, SIGINT, SIGTERM while it read a recording.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of the recording")
    parser.add_argument("--output", type=Path, metavar="FILE",
                        help="where to write the recording's page (default: BAG_FOLDER_view.html)")
    parser.add_argument("--scene", metavar="NAME", help="scene that the robot simulated, by name or file, of a "
                        "recording that does not say it: another recorder's")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    return parser


LARGEST = 96 * 2**20
"""Largest payload of a motion [bytes]: ten minutes of the busiest shipped scene, which take half a gigabyte in a
browser. The rest of a longer motion is left out."""
MOST_IMPACTS = 50_000  # most impacts in a header; of more, the hardest are kept
MOST_FAULTS = 5  # most reasons that are named why a motion is not exact
UNKNOWN_ROBOT = "device"  # scene whose dimensions are drawn when a bag does not state the robot's scene

#: Shares of the work that are done when the samples are read, and when they are simulated again.
_READ_SHARE, _SIMULATED_SHARE = 0.5, 0.7


def bag_motion(folder: Path, progress: Progress = lambda share: None,
               scene: Scene | None = None) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """Compute the motion of the recording in `folder` for a page; nothing is ever written into the folder.

    `progress` is called with the share of the work that is done, from 0 to 1, often enough for a progress bar. `scene`
    is the robot's scene, for a recording that does not state it. BagError when the recording cannot be read, has no
    state, or states its scene although `scene` is given.

    Returns
    -------
    setting : dict
        Parts of the page's setting: ``title``, the folder's name; ``robot``, the scene's name; ``machine``, see
        `drawing.drawing`; ``notes``, sentences on the parts of the bag that are not read or not shown.
    header, payload : dict, bytes
        The motion document, see `motion`. In a recording of the robot's own recorder its times are robot time [s],
        which is 0 at the robot's start; in another one they count from the first message.
    """
    with BagStream(folder) as stream, np.errstate(over="ignore", invalid="ignore"):  # a bag may hold any number
        return _BagMotion(stream, progress, scene).result()


class _BagMotion:
    def __init__(self, stream: BagStream, progress: Progress, scene: Scene | None):
        self._stream, self._progress = stream, progress
        self._faults: list[str] = []  # reasons why the run could not be simulated from its commands
        self._notes: list[str] = []
        self._exact: ExactMotion | None = None
        self._resets: list[float] = []  # instants [s] of the first samples after resets
        self._scene = scene
        self._run: RecordedRun | None = None
        try:
            self._run = recorded_run(stream)
        except BagError as error:
            reason = str(error).removeprefix(f"{stream.folder}: ").partition(";")[0]
            self._faults.append(f"the bag {reason}" if reason.startswith(("says", "cannot")) else reason)
        if self._run and scene:
            raise BagError(f"{stream.folder}: says which scene its robot simulated; leave --scene out")
        self._recorded = Recorded(stream, self._part(0.0, _READ_SHARE))
        if self._run and not self._has_sample_stamps(self._run):
            self._scene, self._run = self._run.scene, None
        self._signals = self._recorded.signals(self._times)
        if not any(len(signal.times) for name, signal in self._signals.items() if is_position(name)):
            raise BagError(f"{stream.folder}: holds no state to draw; give a bag with odom or joint_states")

    def result(self) -> tuple[dict[str, Any], dict[str, Any], bytes]:
        if self._run:
            self._run_again(self._run)
        elif not self._scene:
            self._notes.append("the bag does not say which robot moved; name the robot's scene with --scene")
        self._resets = sorted({*(self._exact.resets if self._exact else ()), *(
            reset_instants(self._signals["crank_angle"]) if "crank_angle" in self._signals else ())})
        inexact = self._inexact_spans()
        if inexact:
            self._recorded.read_forces()
            self._signals = self._recorded.signals(self._times)
        scene = self._scene or load_scene(UNKNOWN_ROBOT)
        names = [name for name in shown_quantities(scene) if self._scene or name in self._signals]
        rest = [interpolate(self._signals, names, span, self._resets) for span in inexact]
        instants = self._exact.instants if self._exact else []
        fitted = fitted_motion(names, self._intervals, instants, rest, LARGEST, self._part(_SIMULATED_SHARE, 1.0))
        if fitted.end < math.inf:
            self._notes.append(f"the motion after {fitted.end:.6g} s is left out: it would not fit into a page")
        if self._recorded.cut_short:
            self._notes.append("the end of the recording is left out: it is too long for a page")
        resolved = fitted.end < math.inf or len(fitted.exact) == len(self._intervals)
        facts = {"exact": resolved and not inexact, "why": self._why(bool(inexact), resolved),
                 "exact_spans": spans(fitted.exact), "impacts": self._impacts(fitted.end),
                 "resets": [time for time in self._resets if time <= fitted.end],
                 "pushes": pushes(self._run, self._recorded.inputs) if self._run else []}
        header, payload = fitted.writer.document(facts)
        self._progress(1.0)
        return {"title": self._stream.folder.resolve().name, "robot": scene.name, "machine": drawing(scene),
                "notes": [*self._notes, *self._stream.flaws]}, header, payload

    @property
    def _intervals(self) -> list[ExactInterval]:
        return self._exact.intervals if self._exact else []

    def _part(self, begin: float, end: float) -> Progress:
        return lambda share: self._progress(begin + (end - begin) * share)

    def _nanoseconds(self, arrays: Arrays, start: int) -> np.ndarray:
        return np.rint(arrays["time"] * 1e9).astype(np.int64) + (self._stream.start - start)

    def _has_sample_stamps(self, run: RecordedRun) -> bool:
        """Return whether all messages were recorded with the stamp of a sample."""
        for arrays in self._recorded.arrays.values():
            stamps = self._nanoseconds(arrays, run.start)
            ticks = np.rint(stamps * 1e-9 * run.rate)
            if (ticks < 0.0).any() or (np.rint(ticks / run.rate * 1e9) != stamps).any():
                self._faults.append("the stamps in the bag are not those of the robot's samples")
                return False
        return True

    def _times(self, arrays: Arrays) -> np.ndarray:
        """Return the instants [s] of a topic's samples; in another recorder's bag, those in the headers if any."""
        if self._run:
            stamps = self._nanoseconds(arrays, self._run.start)
            return np.rint(stamps * 1e-9 * self._run.rate) / self._run.rate
        return arrays.get("stamp", arrays["time"])

    def _run_again(self, run: RecordedRun) -> None:
        """Simulate the recorded run again with its inputs.

        Its samples are all those that any topic has, and those after which the robot received an input.
        """
        is_known = not run.begins_late
        signals = {name: signal for name, signal in self._signals.items() if is_position(name)}
        numbers = {name: np.rint(signal.times * run.rate).astype(np.int64) for name, signal in signals.items()}
        last = max(int(ticks_of_signal[-1]) for ticks_of_signal in numbers.values() if len(ticks_of_signal))
        numbered: list[tuple[int, Input]] = []
        for received in self._recorded.inputs:
            if (tick := run.tick(received.stamp)) is None:
                self._faults.append(f"the stamp {received.stamp} of an input is not that of a sample")
            elif tick <= last:
                numbered.append((tick, received))
        ticks = np.unique(np.concatenate([*numbers.values(), np.array([tick for tick, _ in numbered], np.int64),
                                          np.arange(int(is_known), dtype=np.int64)]))
        positions = {name: np.full(len(ticks), np.nan) for name in signals}
        for name, signal in signals.items():
            positions[name][np.searchsorted(ticks, numbers[name])] = signal.values
        inputs: dict[int, list[Input]] = {}
        for tick, received in numbered:
            inputs.setdefault(int(np.searchsorted(ticks, tick)), []).append(received)
        with without_tolerance_warning():
            rerun = Rerun(run, run.scene)
        self._scene = rerun.scene
        self._exact = ExactMotion(rerun, positions, ticks, inputs, is_known)
        self._exact.walk(self._part(_READ_SHARE, _SIMULATED_SHARE))
        if not is_known and (self._exact.run_since is None or self._exact.run_since > self._ends[0]):
            late = (self._stream.start - run.start) * 1e-9
            self._faults.append(f"the recording begins {late:.6g} s after the robot's start and what it had "
                                "received before is unknown")
        self._faults += self._exact.faults

    @property
    def _ends(self) -> Span:
        """Instants [s] of the first and the last sample."""
        times = [signal.times[[0, -1]] for signal in self._signals.values() if len(signal.times)]
        return min(float(ends[0]) for ends in times), max(float(ends[1]) for ends in times)

    def _inexact_spans(self) -> list[Span]:
        """Return begin and end [s] of each span that is not exact, if there are samples to interpolate it from."""
        return [span for span in inexact_spans(self._intervals, *self._ends)
                if len(interpolate(self._signals, [], span, self._resets)[0])]

    def _why(self, is_open: bool, resolved: bool) -> str:
        """Return why not everything is exact; empty if it is, where a fault without effect is only noted."""
        faults = self._faults[:MOST_FAULTS]
        if self._run and faults:
            faults += notes(self._stream, self._run)
        if is_open:
            return "; ".join([*faults, "there the motion is interpolated between the samples"])
        self._notes += faults
        return "" if resolved else "the motion changes too often to be drawn as finely as it was computed"

    def _impacts(self, end: float) -> list[dict[str, Any]]:
        """Return the computed impacts where the motion is exact, and the recorded ones elsewhere, if there are any."""
        impacts = list(self._exact.impacts) if self._exact else []
        start = (self._stream.start - self._run.start) * 1e-9 if self._run else 0.0
        recorded = [Impact(stamp + start, stamp + start, side, force)
                    for stamp, side, force in self._recorded.impacts()]
        borders = np.array(spans(self._intervals)).ravel()  # exact from each even one to the odd one after it
        borders_before = np.searchsorted(borders, [impact.time for impact in recorded], side="right")
        impacts += [impact for impact, count in zip(recorded, borders_before, strict=True) if count % 2 == 0]
        impacts = [impact for impact in impacts if impact.time <= end]
        if len(impacts) > MOST_IMPACTS:
            impacts = sorted(impacts, key=lambda impact: impact.peak_force)[-MOST_IMPACTS:]
            self._notes.append(f"of the impacts, only the hardest {MOST_IMPACTS} are marked")
        return impacts_as_json(impacts)


def pushes(run: RecordedRun, inputs: Sequence[Input]) -> list[dict[str, float]]:
    """Return the recorded pushes of the body: ``begin``, ``end`` [s] of robot time, ``force_x``, ``force_z`` [N]."""
    pushed: list[dict[str, float]] = []
    for received in inputs:
        tick = run.tick(received.stamp)
        if received.name != OPERATIONS or tick is None:
            continue
        try:
            operation = read_operation(deserialised(received.data, TOPICS[OPERATIONS].type).data)
            if operation.name in (PUSH, RESET):
                time = run.time(tick)
                if pushed:
                    pushed[-1]["end"] = min(pushed[-1]["end"], time)
                if operation.name == PUSH and (duration := DURATION.checked(operation.parameters["duration"])):
                    forces = {name: FORCE.checked(operation.parameters[name]) for name in ("force_x", "force_z")}
                    pushed.append({"begin": time, "end": time + duration, **forces})
        except ValueError:
            pass  # the robot refused it as well
    return [push for push in pushed if push["force_x"] or push["force_z"]]

"""The motion of a recorded robot: what it did at every instant, not only when it published.

A robot's own recording is simulated again from its commands, and is exact wherever that passes through the recorded
positions. All else is interpolated between the samples, and said to be.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vibro_ros.bag.reader import Arrays
from vibro_ros.bag.stream import BagError, BagStream
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.recordings.comparison import notes
from vibro_ros.recordings.rerun import RunFacts, run_facts
from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.view.assembly import Assembly, Span, spans
from vibro_ros.view.contacts import Impact, as_json
from vibro_ros.view.interpolation import interpolated
from vibro_ros.view.machine import machine, shown
from vibro_ros.view.recorded import Progress, Recorded
from vibro_ros.view.resimulation import Resimulation

LARGEST = 64 * 2**20
"""Bytes of a motion's payload, half an hour of the busiest shipped scene; what comes later is left out."""
MOST_IMPACTS = 50_000
"""Impacts in a header; of more, the hardest."""
MOST_FAULTS = 5
"""Reasons that are told, why not all of a motion is exact."""
UNKNOWN_ROBOT = "device"
"""Scene whose lengths are drawn when a bag does not say which robot moved."""

_SILENT: Progress = lambda share: None  # noqa: E731
#: Shares of the work that are done when the samples are read, and when they are simulated again.
_READ, _SIMULATED = 0.6, 0.7



def bag_motion(folder: Path, progress: Progress = _SILENT) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """The motion of a recording, as a page shows it.

    Parameters
    ----------
    folder : Path
        The bag; nothing is ever written into it.
    progress : callable
        Is told the share of the work that is done, from 0 to 1, often enough for a bar of progress.

    Returns
    -------
    setting : dict
        Parts of the page's setting: ``title``, the folder's name; ``robot``, the scene's name; ``machine``, see
        `machine.machine`; ``notes``, sentences on what of the bag is not read or not shown.
    header, payload : dict, bytes
        The motion document, see `motion`. Its times are robot time [s], which is 0 at the robot's start, in a robot's
        own recording; in another one they count from the first message.

    Raises
    ------
    BagError
        When the recording cannot be read, or holds no state.
    """
    with BagStream(folder) as stream:
        return _Making(stream, progress).result()


class _Making:
    """Makes the motion of one bag, step by step."""

    def __init__(self, stream: BagStream, progress: Progress):
        self._stream, self._progress = stream, progress
        self._faults: list[str] = []
        self._left_out: list[str] = []
        self._facts = self._known_facts()
        self._recorded = Recorded(stream, self._part(0.0, _READ))
        self._facts = self._facts if self._facts and self._are_ticks(self._facts) else None
        self._tracks = self._recorded.tracks(self._times)
        if not any(len(track.times) for track in self._tracks.values()):
            raise BagError(f"{stream.folder}: holds no state to draw; give a bag with odom or joint_states")
        self._run = self._simulated(self._facts) if self._facts else None

    def result(self) -> tuple[dict[str, Any], dict[str, Any], bytes]:
        """See `bag_motion`."""
        exact = spans(self._run.stretches) if self._run else []
        between = list(self._not_exact(exact))
        if between:
            self._recorded.read_forces(_SILENT)
            self._tracks = self._recorded.tracks(self._times)
        scene = self._run.scene if self._run else load_scene(UNKNOWN_ROBOT)
        names = [name for name in shown(scene) if self._run or name in self._tracks]
        made = self._assembled(names, between)
        facts = {"exact": made.resolved and not between, "why": self._why(between, made.resolved),
                 "exact_spans": exact, "impacts": self._impacts(exact), "resets": self._resets()}
        header, payload = made.writer.document(facts)
        self._progress(1.0)
        return {"title": self._stream.folder.resolve().name, "robot": scene.name, "machine": machine(scene),
                "notes": [*self._left_out, *self._stream.flaws]}, header, payload

    def _part(self, begin: float, end: float) -> Progress:
        return lambda share: self._progress(begin + (end - begin) * share)

    def _known_facts(self) -> RunFacts | None:
        try:
            return run_facts(self._stream)
        except BagError as error:
            self._faults.append(str(error).removeprefix(f"{self._stream.folder}: ").partition(";")[0])
            return None

    def _nanoseconds(self, arrays: Arrays, start: int) -> np.ndarray:
        """Recorded stamps [ns] after `start`."""
        return np.rint(arrays["time"] * 1e9).astype(np.int64) + (self._stream.start - start)

    def _are_ticks(self, facts: RunFacts) -> bool:
        """Whether everything was recorded with the stamp of a sample."""
        for arrays in self._recorded.arrays.values():
            stamps = self._nanoseconds(arrays, facts.start)
            ticks = np.rint(stamps * 1e-9 * facts.rate)
            if (ticks < 0.0).any() or (np.rint(ticks / facts.rate * 1e9) != stamps).any():
                self._faults.append("its stamps are not those of the robot's samples")
                return False
        return True

    def _times(self, arrays: Arrays) -> np.ndarray:
        """Instants [s] of a topic's samples; of another recorder's bag the robot's own stamps where there are any."""
        if self._facts:
            stamps = self._nanoseconds(arrays, self._facts.start)
            return np.rint(stamps * 1e-9 * self._facts.rate) / self._facts.rate
        return arrays.get("stamp", arrays["time"])

    def _simulated(self, facts: RunFacts) -> Resimulation:
        is_late = self._stream.start > facts.start
        prepare_kernels("view", facts.scene["solver.method"])
        run = Resimulation(facts, self._tracks, not is_late)
        run.run(self._recorded.inputs, self._part(_READ, _SIMULATED))
        return run

    def _not_exact(self, exact: list[Span]) -> Iterator[Span]:
        """Begin and end [s] of what is between the exact spans; between the last sample before a reset and the first
        one after it there is nothing."""
        times = [track.times[[0, -1]] for track in self._tracks.values() if len(track.times)]
        begin, last = min(float(one[0]) for one in times), max(float(one[1]) for one in times)
        period = 1.0 / self._facts.rate if self._facts else 0.0
        resets = np.array(self._resets() if self._run else [])
        for span in [*exact, (last, last)]:
            is_reset = len(resets) and np.abs(resets - span[0]).min() < 0.5 * period
            if span[0] > begin + (1.5 if is_reset else 0.5) * period:
                yield begin, span[0]
            begin = span[1]

    def _assembled(self, names: list[str], between: list[Span]) -> Assembly:
        """Everything in the order of time."""
        run = self._run
        rest = [interpolated(self._tracks, names, begin, end) for begin, end in between]
        made = Assembly(names, run.stretches if run else [], run.instants if run else [], rest)
        made.write(LARGEST, self._part(_SIMULATED, 1.0))
        if made.end < math.inf:
            self._left_out.append(f"the motion after {made.end:.6g} s is left out: it would not fit into a page")
        if self._recorded.cut_short:
            self._left_out.append("the end of the recording is left out: it is too long for a page")
        return made

    def _why(self, between: list[Span], resolved: bool) -> str:
        """Why not everything is exact; empty when it is."""
        if not between:
            return "" if resolved else (f"by solver.method {self._run.scene['solver.method']} the motion changes with "
                                        "every step, which is drawn less finely" if self._run else "")
        faults = [*self._faults, *(self._run.faults if self._run else [])]
        if self._facts and self._run:
            faults += notes(self._stream, self._facts)
        return "; ".join([*faults[:MOST_FAULTS], "there the motion is interpolated between the samples"])

    def _impacts(self, exact: list[Span]) -> list[dict[str, Any]]:
        """Computed impacts where the motion is exact, elsewhere the recorded ones, as far as the bag holds them."""
        found = list(self._run.impacts) if self._run else []
        start = (self._stream.start - self._facts.start) * 1e-9 if self._facts else 0.0
        recorded = [Impact(stamp + start, stamp + start, side, force)
                    for stamp, side, force in self._recorded.impacts()]
        borders = np.array(exact).ravel()  # between an even and an odd one lies what is exact
        before = np.searchsorted(borders, [one.time for one in recorded], side="right")
        found += [one for one, count in zip(recorded, before, strict=True) if count % 2 == 0]
        if len(found) > MOST_IMPACTS:
            found = sorted(found, key=lambda one: one.peak_force)[-MOST_IMPACTS:]
            self._left_out.append(f"of the impacts, only the hardest {MOST_IMPACTS} are marked")
        return as_json(found)

    def _resets(self) -> list[float]:
        if self._run:
            return self._run.resets
        crank = self._tracks.get("crank_angle")
        return crank.times[1:][np.diff(crank.values) < 0.0].tolist() if crank else []

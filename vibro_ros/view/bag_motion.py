"""The motion of a recorded robot: what it did at every instant, not only when it published.

A robot's own recording is simulated again from its commands, and is exact wherever that passes through the recorded
positions. All else is interpolated between the samples, and said to be.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from vibro_ros.bag.reader import Arrays
from vibro_ros.bag.stream import BagError, BagStream
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.model.scene import Scene
from vibro_ros.recordings.comparison import notes
from vibro_ros.recordings.rerun import RunFacts, run_facts
from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.view.following import Following, common_samples, recognised, regular, state_of
from vibro_ros.view.machine import machine, shown, voltage
from vibro_ros.view.motion import Impact, impacts_as_json, is_place
from vibro_ros.view.pieces import Assembly
from vibro_ros.view.recorded import Recorded, Track, interpolated, reset_instants
from vibro_ros.view.resimulation import Resimulation, pushes
from vibro_ros.view.stretch import ExactRun, Progress, Span, Stretch, quiet_device, spans

LARGEST = 96 * 2**20
"""Bytes of a motion's payload: ten minutes of the busiest shipped scene, which take a browser half a gigabyte. What
comes later is left out."""
MOST_IMPACTS = 50_000
"""Impacts in a header; of more, the hardest."""
MOST_FAULTS = 5
"""Reasons that are told, why not all of a motion is exact."""
UNKNOWN_ROBOT = "device"
"""Scene whose lengths are drawn when a bag does not say which robot moved."""

#: Shares of the work that are done when the samples are read, and simulated again or followed.
_READ, _SIMULATED = 0.5, 0.7


def bag_motion(folder: Path, progress: Progress = lambda share: None) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """The motion of the recording in `folder`, into which nothing is ever written, as a page shows it.

    `progress` is told the share of the work that is done, from 0 to 1, often enough for a bar. BagError when the
    recording cannot be read, or holds no state.

    Returns
    -------
    setting : dict
        Parts of the page's setting: ``title``, the folder's name; ``robot``, the scene's name; ``machine``, see
        `machine.machine`; ``notes``, sentences on what of the bag is not read or not shown.
    header, payload : dict, bytes
        The motion document, see `motion`. Its times are robot time [s], which is 0 at the robot's start, in a robot's
        own recording; in another one they count from the first message.
    """
    with BagStream(folder) as stream, np.errstate(over="ignore", invalid="ignore"):  # a bag may hold any number
        return _Making(stream, progress).result()


class _Making:
    def __init__(self, stream: BagStream, progress: Progress):
        self._stream, self._progress = stream, progress
        self._faults: list[str] = []  # why it could not be simulated again from its commands
        self._notes: list[str] = []
        self._exact: list[ExactRun] = []
        self._scene: Scene | None = None
        self._facts: RunFacts | None = None
        try:
            self._facts = run_facts(stream)
        except BagError as error:
            said = str(error).removeprefix(f"{stream.folder}: ").partition(";")[0]
            self._faults.append(f"the bag {said}" if said.startswith(("says", "cannot")) else said)
        self._recorded = Recorded(stream, self._part(0.0, _READ))
        if self._facts and not self._are_ticks(self._facts):
            self._scene, self._facts = self._facts.scene, None
        self._tracks = self._recorded.tracks(self._times)
        if not any(len(track.times) for name, track in self._tracks.items() if is_place(name)):
            raise BagError(f"{stream.folder}: holds no state to draw; give a bag with odom or joint_states")

    def result(self) -> tuple[dict[str, Any], dict[str, Any], bytes]:
        if self._facts:
            self._simulate(self._facts)
        self._follow(self._open_spans())
        between = self._open_spans()
        if between:
            self._recorded.read_forces()
            self._tracks = self._recorded.tracks(self._times)
        scene = self._scene or load_scene(UNKNOWN_ROBOT)
        self._add_voltage(scene)
        names = [name for name in shown(scene) if self._scene or name in self._tracks]
        rest = [interpolated(self._tracks, names, span, self._resets()) for span in between]
        made = Assembly(names, self._stretches, [times for one in self._exact for times in one.instants], rest)
        made.write(LARGEST, self._part(_SIMULATED, 1.0))
        if made.end < math.inf:
            self._notes.append(f"the motion after {made.end:.6g} s is left out: it would not fit into a page")
        if self._recorded.cut_short:
            self._notes.append("the end of the recording is left out: it is too long for a page")
        resolved = made.end < math.inf or len(made.exact) == len(self._stretches)
        facts = {"exact": resolved and not between, "why": self._why(bool(between), resolved),
                 "exact_spans": spans(made.exact), "impacts": self._impacts(made.end),
                 "resets": [time for time in self._resets() if time <= made.end],
                 "pushes": pushes(self._facts, self._recorded.inputs) if self._facts else []}
        header, payload = made.writer.document(facts)
        self._progress(1.0)
        return {"title": self._stream.folder.resolve().name, "robot": scene.name, "machine": machine(scene),
                "notes": [*self._notes, *self._stream.flaws]}, header, payload

    @property
    def _stretches(self) -> list[Stretch]:
        return sorted((stretch for one in self._exact for stretch in one.stretches), key=lambda stretch: stretch.span)

    def _part(self, begin: float, end: float) -> Progress:
        return lambda share: self._progress(begin + (end - begin) * share)

    def _nanoseconds(self, arrays: Arrays, start: int) -> np.ndarray:
        return np.rint(arrays["time"] * 1e9).astype(np.int64) + (self._stream.start - start)

    def _are_ticks(self, facts: RunFacts) -> bool:
        """Whether everything was recorded with the stamp of a sample."""
        for arrays in self._recorded.arrays.values():
            stamps = self._nanoseconds(arrays, facts.start)
            ticks = np.rint(stamps * 1e-9 * facts.rate)
            if (ticks < 0.0).any() or (np.rint(ticks / facts.rate * 1e9) != stamps).any():
                self._faults.append("the stamps in the bag are not those of the robot's samples")
                return False
        return True

    def _times(self, arrays: Arrays) -> np.ndarray:
        """Instants [s] of a topic's samples; of another recorder's bag the robot's own stamps where there are any."""
        if self._facts:
            stamps = self._nanoseconds(arrays, self._facts.start)
            return np.rint(stamps * 1e-9 * self._facts.rate) / self._facts.rate
        return arrays.get("stamp", arrays["time"])

    def _simulate(self, facts: RunFacts) -> None:
        is_late = self._stream.start > facts.start
        prepare_kernels("view", facts.scene["solver.method"])
        run = Resimulation(facts, self._tracks, not is_late)
        run.run(self._recorded.inputs, self._part(_READ, _SIMULATED))
        self._exact.append(run)
        self._scene = run.scene
        if is_late and not (run.stretches and run.stretches[0].span[0] <= self._ends[0]):
            self._faults.append(f"the recording begins {(self._stream.start - facts.start) * 1e-9:.6g} s after the "
                                "robot's start and what it had been told is unknown")
        self._faults += run.faults

    def _follow(self, between: list[Span]) -> None:
        if not between:
            return
        prepare_kernels("view", "exact")
        scene = self._scene or recognised(map(load_scene, shipped_scenes()), self._tracks)
        if scene is None or not set(state_of(scene)) <= set(self._tracks):
            return
        if self._scene is None:
            self._notes.append("the bag does not say which robot moved; its samples are those of the scene "
                               f"{scene.name}")
        self._scene, device = scene, quiet_device(scene)
        samples, times = common_samples(self._tracks, state_of(scene))
        even = times if self._facts else regular(times)
        for begin, end in between:
            inside = slice(*np.searchsorted(times, [begin, np.nextafter(end, np.inf)]))
            one = Following(device, {name: column[inside] for name, column in samples.items()}, even[inside])
            one.follow()
            self._exact.append(one)
            self._faults += one.faults

    def _add_voltage(self, scene: Scene) -> None:
        """Add what is not recorded of a dc motor, at the instants of what is."""
        names = ("motor_current", "electrical_power", "motor_speed")
        if scene.has_rotor and set(names) <= set(self._tracks):
            samples, times = common_samples(self._tracks, names)
            self._tracks["motor_voltage"] = Track(times, voltage(scene, *(samples[name] for name in names)), None)

    @property
    def _ends(self) -> Span:
        """Instants [s] of the first and the last sample."""
        times = [track.times[[0, -1]] for track in self._tracks.values() if len(track.times)]
        return min(float(one[0]) for one in times), max(float(one[1]) for one in times)

    def _open_spans(self) -> list[Span]:
        """Begin and end [s] of what is not exact, where there are samples to draw it from."""
        begin, last = self._ends
        found, resets = [], self._resets()
        for span in [*spans(self._stretches), (last, last)]:
            if len(interpolated(self._tracks, [], (begin, span[0]), resets)[0]):
                found.append((begin, span[0]))
            begin = span[1]
        return found

    def _why(self, is_open: bool, resolved: bool) -> str:
        """Why not everything is exact; empty when it is. That the samples had to be followed is only a note."""
        faults = self._faults
        if faults and self._facts:
            faults = [*faults[:MOST_FAULTS], *notes(self._stream, self._facts)]
        if is_open:
            return "; ".join([*faults[:MOST_FAULTS], "there the motion is interpolated between the samples"])
        if faults:
            self._notes.append("; ".join([*faults[:MOST_FAULTS], "there the motion is computed from sample to sample"]))
        return "" if resolved else "the motion changes too often to be drawn as finely as it was computed"

    def _impacts(self, end: float) -> list[dict[str, Any]]:
        """Computed impacts where the motion is exact, elsewhere the recorded ones, as far as the bag holds them."""
        found = [impact for one in self._exact for impact in one.impacts]
        start = (self._stream.start - self._facts.start) * 1e-9 if self._facts else 0.0
        recorded = [Impact(stamp + start, stamp + start, side, force)
                    for stamp, side, force in self._recorded.impacts()]
        borders = np.array(spans(self._stretches)).ravel()  # between an even and an odd one lies what is exact
        before = np.searchsorted(borders, [one.time for one in recorded], side="right")
        found += [one for one, count in zip(recorded, before, strict=True) if count % 2 == 0]
        found = [one for one in found if one.time <= end]
        if len(found) > MOST_IMPACTS:
            found = sorted(found, key=lambda one: one.peak_force)[-MOST_IMPACTS:]
            self._notes.append(f"of the impacts, only the hardest {MOST_IMPACTS} are marked")
        return impacts_as_json(found)

    def _resets(self) -> list[float]:
        """Instants [s] of samples at which the robot stood at its start again."""
        if self._facts and self._exact:
            return self._exact[0].resets
        return reset_instants(self._tracks["crank_angle"]) if "crank_angle" in self._tracks else []

"""A state that was written into a device's arrays, as a checkpoint is restored: whether it can be one.

A bag may be forged. What is refused here would read foreign memory, run for ever, or is of no device of the scene.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model
from vibro_ros.simulation.influences import Influences
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import State
from vibro_ros.solver.system import BY_COMMAND, BY_CURRENT, NOTHING

#: No number of a device's state is larger, in SI units and counts; beyond it a checkpoint is of no device.
_LARGEST = 1e15
#: Nor is a local time of the present segment, but for rounding.
_LOCAL = 1.0 + 1e-9
_CLOSE = 1e-6  # relative, of what follows from other numbers
#: A crank that is a coordinate is within a turn where a segment starts, and within this angle [rad] where it ends.
_MOST_TURNED = 30.0


@dataclass(frozen=True)
class WrittenState:
    """What was written, and what it is to fit.

    Attributes
    ----------
    scene, model : Scene, Model
        The scene, and as it is compiled with the influences.
    time : float
        Simulated time [s].
    state, point, influences : State, ndarray, Influences
        The device's.
    filters : (ndarray, ndarray)
        Channels and rates [1/s] that the low-pass filters must have.
    by_steps : bool
        Whether the device takes steps of fixed length.
    arrays : sequence of ndarray
        All that was written.
    """

    scene: Scene
    model: Model
    time: float
    state: State
    point: np.ndarray
    influences: Influences
    filters: tuple[np.ndarray, np.ndarray]
    by_steps: bool
    arrays: Sequence[np.ndarray]

    def is_possible(self) -> bool:
        """Whether the arrays point at nothing beyond the scene's tables, where a kernel would read foreign memory, are
        finite, lie within the segment where they are local times, and need no endless time to get to `time` or on from
        there."""
        system, now = self.model.system, self.state.now[0]
        segment, drive, automaton = now["segment"], now["drive"], now["automaton"]
        places = ((automaton["guard"], NOTHING, system.guard.shape[1]), (drive["cell"], 0, len(system.signals.reach)),
                  (segment["slot"], 0, len(system.signals.start) + 1),
                  (automaton["mode"], 0, len(self.model.modes)))
        if not all(low <= place < high for place, low, high in places):
            return False
        cut = not self.by_steps or self.scene["solver.method"] == "rk4_located"  # other steps are never cut
        shortest = 0.0 if cut else 0.25 * self.scene["solver.step"]
        local = ("flow_start", "mode_start", "next_event")
        within = ((now["accounts"]["booked"], -_LOCAL, _LOCAL), *((segment[name], -_LOCAL, _LOCAL) for name in local),
                  (segment["half"], shortest, LONGEST_SEGMENT),
                  (segment["residue"], -LONGEST_SEGMENT, LONGEST_SEGMENT),
                  (self.time - segment["start"], -2.0 * LONGEST_SEGMENT, 2.0 * LONGEST_SEGMENT))
        moving, constant = (self.time, *(drive[name] for name in drive.dtype.names)), self.state.z[-1]
        numbers = np.concatenate([np.ravel(part) for part in self.arrays])
        endless = np.count_nonzero(~(np.abs(numbers) <= _LARGEST))
        return (all(map(math.isfinite, moving)) and all(low <= number <= high for number, low, high in within)
                and all(map(np.array_equal, self.filters, (self.state.lowpass["channel"], self.state.lowpass["rate"])))
                and constant[0] in (0.0, 1.0) and not constant[1:].any() and self._can_drive()
                and self.influences.are_possible(self.scene, self.model.forms, self.time)
                and (not self.scene.has_rotor or self._can_control())
                and endless == (segment["cell_left"] > _LARGEST))  # of a crank that stands, or nearly so

    def _can_control(self) -> bool:
        """Whether a dc motor can be at this angle, be held so and take its next sample then."""
        motor, controller = self.state.now["motor"][0], self.model.system.rotor.controller[0]
        at, scene = self.model.forms.channels, self.scene
        angles = self.point[at.phase], self.state.mode_point[at.phase], np.abs(self.state.z[at.phase]).sum()
        sampled, step = controller["law"] != BY_COMMAND, scene["solver.step"] if self.by_steps else 0.0
        ahead = motor["samples"] * controller["period"] - self.state.now["segment"]["start"][0]
        most = scene["motor.current_limit" if controller["law"] == BY_CURRENT else "motor.supply_voltage"]
        command = scene["motor.max_speed" if sampled else "motor.supply_voltage"]
        fastest = BY_NAME["motor.max_speed"].maximum
        return (all(abs(angle) <= _MOST_TURNED for angle in angles) and abs(motor["held"]) <= most * (1.0 + _CLOSE)
                and abs(motor["target"]) <= command and abs(motor["reference"]) <= fastest
                and abs(motor["slope"]) in (0.0, scene["motor.acceleration"]) and 0.0 <= motor["since"] <= self.time
                and (-step - _CLOSE * controller["period"] <= ahead <= (1.0 + _CLOSE) * controller["period"]
                     if sampled else motor["samples"] == 0))

    def _can_drive(self) -> bool:
        """Whether the motor and the plates of the scene can move as the drive and the ramps have it."""
        scene, drive, law = self.scene, self.state.now["drive"][0], self.scene["effects.motor"]
        start, fastest = self.model.system.signals.start, BY_NAME["motor.max_speed"].maximum
        width, time, lag = start[drive["cell"] + 1] - start[drive["cell"]], drive["cell_time"], drive["lag"]
        at, actuator = self.model.forms.channels, scene["gap_actuator.speed"]
        plates, rates = np.split(self.state.z[at.ramp(0):at.ramp(2 * at.ramps)], 2)
        if (np.abs(plates[:, :1]) > 2.0 * scene.longest_rod).any() or (np.abs(plates[:, 1]) > actuator).any() or (
                plates[:, 2:].any() or rates[:, 1:].any() or (np.abs(rates[:, 0]) > actuator).any()):
            return False
        if drive["time_left"] > 0.0 and time != 0.0:  # which must be the time that the cell takes
            passed = time * (drive["cell_speed"] + 0.5 * drive["acceleration"] * time)
            if lag > 0.0:
                away = drive["cell_speed"] - drive["target"]
                passed = drive["target"] * time - away * lag * math.expm1(-time / lag)
            if not abs(passed - width) <= _CLOSE * width:
                return False
        return (all(0.0 <= drive[name] <= fastest for name in ("speed", "cell_speed"))
                and drive["direction"] in (-1, 1) and abs(drive["target"]) <= fastest and _can_turn_back(drive, fastest)
                and abs(drive["acceleration"]) in (0.0, scene["motor.acceleration"] * (law == "ramp"))
                and lag in (0.0, scene["motor.time_constant"] * (law == "lag"))
                and all(abs(rate) in (0.0, actuator) for rate in self.state.ramp["rate"])
                and all(drive[name] >= 0.0 for name in ("since", "cell_time", "time_left"))
                and 0.0 <= drive["offset"] <= width * (1.0 + _CLOSE))


def _can_turn_back(drive: np.void, fastest: float) -> bool:
    """Whether a speed whose target is in the other direction falls to 0 in the time that is left, to rounding of the
    `fastest` [rad/s] that it may have come from."""
    speed, target, acceleration, lag, left = (
        float(drive[name]) for name in ("speed", "target", "acceleration", "lag", "time_left"))
    if target >= 0.0 or left <= 0.0:
        return target >= 0.0
    end = target + (speed - target) * math.exp(-left / lag) if lag > 0.0 else speed + acceleration * left
    return abs(end) <= _CLOSE * fastest

"""Motor and plates: their commanded values, and commands written into the solver's state.

The command to a stalled motor or a stuck plate is stored with the disturbance, which ends with that command.
"""

import math
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model
from vibro_ros.simulation.disturbances import STALL, STUCK, Disturbances
from vibro_ros.solver.drive import command_drive, speed_and_target
from vibro_ros.solver.events import leave_for_ramp
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.rotor import command_rotor
from vibro_ros.solver.state import State


class Actuators(NamedTuple):
    """The motor and the plates of a compiled scene in a state; a command changes `state` and `disturbances`.

    A command is given between two segments, at the end of the interrupted one.
    """

    scene: Scene
    model: Model
    state: State
    disturbances: Disturbances

    @property
    def motor_target(self) -> float:
        """Commanded speed of the motor [rad/s], or commanded voltage [V] if the motor takes that."""
        if self.scene.has_rotor:
            return float(self.state.now["motor"]["target"][0])
        stored = self.disturbances.stored_command(STALL)
        return speed_and_target(self.state.now["drive"][0])[1] if stored is None else stored

    @property
    def controller_integral(self) -> float:
        """Integral of a dc motor's controller before its next sample [V or A]; 0 without a controller."""
        return float(self.state.now["motor"]["integral"][0])

    def command_motor(self, time: float, target: float, speed: float | None = None) -> None:
        """Command the motor at `time` [s] to go to `target` from `speed` [rad/s], or from its present speed if None."""
        if self.scene.has_rotor:
            command_rotor(self.model.system, self.state, time, target, self.scene["motor.acceleration"])
            return
        signals, drive, stall = self.model.system.signals, self.state.now["drive"][0], self.disturbances.row(STALL)
        if stall[0]:
            stall[1], target = target, 0.0
        speed = speed_and_target(drive)[0] if speed is None else speed
        if self.scene["effects.motor"] == "ideal":
            command_drive(signals, drive, target, target)
        elif self.scene["effects.motor"] == "lag":
            command_drive(signals, drive, speed, target, lag=self.scene["motor.time_constant"])
        else:
            command_drive(signals, drive, speed, target, acceleration=self.scene["motor.acceleration"])

    def plate_target(self, side: str) -> float:
        """Return the commanded position of the plate [m]."""
        stored = self.disturbances.stored_command(STUCK, side)
        return float(self.state.ramp["target"][self.model.forms.plates.index(side)]) if stored is None else stored

    def command_plate(self, side: str, target: float, point: np.ndarray, events: np.ndarray) -> int:
        """Command a plate to go to `target` [m]; `point` are all channels now.

        Return the number of contacts that end with the plate's change of speed, which are written into `events`.
        """
        plate, stuck, ended = self.model.forms.plates.index(side), self.disturbances.row(STUCK, side), 0
        ramp = self.state.ramp[plate]
        if stuck[0]:
            stuck[1], target = target, float(ramp["value"])
        speed, difference = self.scene["gap_actuator.speed"], target - ramp["value"]
        rate = math.copysign(speed, difference) if difference != 0.0 else 0.0
        if rate != ramp["rate"]:  # else a mass that rests on the plate goes on resting
            ended = leave_for_ramp(self.model.laid.layout, Laid(self.state).layout, plate, point, events, 0)
        ramp["target"], ramp["rate"], ramp["time_left"] = target, rate, abs(difference) / speed
        return ended

"""The peer's motors: one whose speed is given in time, and a dc motor with bearing, current loop and controller."""

import math
from collections.abc import Callable

import numpy as np

from tools.peer.equations import Equations
from tools.peer.run_state import RunState
from vibro_ros.model.scene import Scene

_SAME_INSTANT = 1e-13  # s; a time of about 1 s is rounded by 1e-16
_SPEED_NUDGE = 1e-15  # rad/s
_VOLTAGE_NUDGE = 1e-12  # V


class GivenMotor:
    """A motor whose speed follows from the commands alone: `ideal`, `ramp` or `lag`."""

    def __init__(self, scene: Scene, run: RunState):
        self._scene, self._run, self._kind = scene, run, scene["effects.motor"]

    def start(self, angle: float) -> None:
        """Turn at `motor.speed` from the `angle` [rad] on."""
        self._angle, self._speed, self._target = angle, self._scene["motor.speed"], self._scene["motor.speed"]
        self._set()

    def command(self, now: float, value: float) -> None:
        """Change to the speed `value` [rad/s], from the instant `now` [s] on."""
        self._target = value
        if self._kind == "ideal":
            self._speed = value
        self._set()

    def settle(self, time: float) -> None:
        """Nothing depends on the motion."""

    def reconsider(self, time: float, struck: bool = False) -> None:
        """Nothing depends on the forces."""

    def actions(self) -> dict[str, Callable[[float, int], None]]:
        """No guards."""
        return {}

    def next_instant(self, now: float) -> float:
        """The end of the ramp [s]."""
        if self._kind == "ramp" and self._change:
            return now + (self._target - self._speed) / self._change
        return math.inf

    def move_on(self, now: float, later: float) -> None:
        """Go on from the instant `now` [s] for `later` [s]."""
        ends = self.next_instant(now) - now <= later + _SAME_INSTANT
        self._angle, self._speed = (float(value) for value in self._at(later))
        if ends:
            self._speed = self._target
        self._set()

    def driven(self, times: np.ndarray, points: np.ndarray) -> np.ndarray:
        """theta, theta', V, i, and theta'' `times` [s] after now, shape (n, 5)."""
        found = np.zeros((len(times), 5))
        found[:, 0], found[:, 1] = self._at(times)
        found[:, 4] = self._change
        if self._kind == "lag":
            lag = self._scene["motor.time_constant"]
            found[:, 4] *= -np.exp(-times / lag) / lag
        return found

    def _set(self) -> None:
        change = {"ideal": 0.0, "lag": self._speed - self._target,
                  "ramp": math.copysign(self._scene["motor.acceleration"], self._target - self._speed)}
        self._change = change[self._kind] if self._target != self._speed else 0.0
        steady = self._target if self._kind == "lag" else self._speed
        for name, value in (("angle", self._angle), ("speed", steady), ("change", self._change)):
            self._run.set_parameter(name, value)

    def _at(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Crank angle [rad] and speed [rad/s] after `t` [s] without another command."""
        if self._kind == "lag":
            lag = self._scene["motor.time_constant"]
            part = -np.expm1(-t / lag)
            return self._angle + self._target * t + self._change * lag * part, self._speed - self._change * part
        return self._angle + self._speed * t + 0.5 * self._change * t * t, self._speed + self._change * t


class DcMotor:
    """A dc motor: the bearing turns or is stuck, the current loop is within the supply's limits or at one of them.

    Attributes
    ----------
    feel_jump : callable
        What is called with the time [s] when theta'' has jumped.
    """

    def __init__(self, equations: Equations, run: RunState):
        self._equations, self._run, self._scene = equations, run, equations.scene
        self._theta, self._omega = equations.crank, equations.crank + 1
        scene = equations.scene
        self._law, self._static = scene["motor.control"], scene["motor.static_friction"]
        self._supply, self._most, self._rate = (
            scene[f"motor.{name}"] for name in ("supply_voltage", "current_limit", "control_rate"))
        self.feel_jump: Callable[[float], None] = lambda time: None

    def start(self, angle: float) -> None:
        """Turn at `motor.speed` from the `angle` [rad] on; the current is zero."""
        scene, state = self._scene, self._run.state
        state[self._theta], state[self._omega] = angle, scene["motor.speed"]
        self._integral, self._samples, self._held = 0.0, 0, 0.0
        self._bearing = "stuck" if self._static and scene["motor.speed"] == 0.0 else ""
        self._goal = self._reference = scene["motor.speed"]
        self._since = self._slope = 0.0
        if self._law == "voltage":
            self._hold(scene["motor.voltage"])
        self._limit = 0.0

    def command(self, now: float, value: float) -> None:
        """Change to the speed [rad/s] or the voltage [V] `value`, from the instant `now` [s] on."""
        if self._law == "voltage":
            self._hold(value)
            return
        self._reference, _ = self._reference_at(now)
        ramp = self._scene["motor.acceleration"]
        self._goal, self._since = value, now
        if ramp == 0.0 or value == self._reference:
            self._reference, self._slope = value, 0.0
        else:
            self._slope = ramp if value > self._reference else -ramp

    def next_instant(self, now: float) -> float:
        """The next sample's [s]."""
        return math.inf if self._law == "voltage" else self._samples * (1.0 / self._rate)

    def move_on(self, now: float, later: float) -> None:
        """Nothing is counted from now: theta is in the state."""

    def settle(self, now: float) -> None:
        """Take a sample that is due at the instant `now` [s], and decide bearing and current loop by the values."""
        if self.next_instant(now) <= now:
            self._sample(now)
        self._settle_loop(0.0)
        speed = self._run.state[self._omega]
        if self._static == 0.0 or speed != 0.0:
            self._turn(math.copysign(1.0, speed) if self._static else 0.0)
        else:
            self._leave_or_stay(0.0)

    def _settle_loop(self, time: float) -> None:
        if self._equations.has_current_loop:
            wanted = self._run.wanted_voltage(time)
            self._enter_limit(float(wanted > self._supply) - float(wanted < -self._supply))

    def _sample(self, now: float) -> None:
        """Take one sample: the clamp, and the integral that does not wind up."""
        scene, speed = self._scene, float(self._run.state[self._omega])
        reference, slope = self._reference_at(now)
        error = reference - speed
        asked = scene["motor.proportional_gain"] * error + self._integral
        if self._law == "speed_by_voltage":
            asked += scene["motor.feed_forward"] * reference
            counter = self._equations.constant * speed
            swing = scene["motor.winding_resistance"] * self._most
            applied = float(np.clip(np.clip(asked, counter - swing, counter + swing), -self._supply, self._supply))
            winds = applied != asked and error * (asked - applied) > 0.0
        else:
            asked += scene["motor.feed_forward"] * slope
            applied = float(np.clip(asked, -self._most, self._most))
            winds = applied != asked and error * asked > 0.0
        if not winds:
            self._integral += scene["motor.integral_gain"] / self._rate * error
        self._samples += 1
        self._hold(applied)

    def _reference_at(self, now: float) -> tuple[float, float]:
        """The speed that the controller follows [rad/s], and its rate [rad/s²]."""
        ramped = self._reference + self._slope * (now - self._since)
        if self._slope == 0.0 or (ramped >= self._goal) == (self._slope > 0.0):
            return self._goal, 0.0
        return ramped, self._slope

    def _hold(self, value: float) -> None:
        self._held = value
        self._run.set_parameter("held", value)

    def actions(self) -> dict[str, Callable[[float, int], None]]:
        """The action of each guard: a function of time [s] and the sign of the guard's derivative."""
        return {"crank forward": lambda t, d: self._leave(t, 1.0) if self._bearing == "stuck" else self._stop(t),
                "crank backward": lambda t, d: self._leave(t, -1.0),
                "upper limit": lambda t, d: self._cross_limit(t, 0.0 if self._limit else 1.0),
                "lower limit": lambda t, d: self._cross_limit(t, -1.0)}

    def _leave(self, time: float, way: float) -> None:
        self._run.state[self._omega] = way * _SPEED_NUDGE
        self._turn(way, time)
        self.feel_jump(time)

    def _stop(self, time: float) -> None:
        self._run.state[self._omega] = 0.0
        self._leave_or_stay(time)
        self.feel_jump(time)

    def _leave_or_stay(self, time: float) -> None:
        """Stick, or turn the way of the torque if the torque exceeds what the bearing holds."""
        torque = self._run.motor_torque(time)
        if abs(torque) <= self._static:
            self._enter("stuck", 0.0, 0.0, time)
        else:
            way = math.copysign(1.0, torque)
            self._run.state[self._omega] = way * _SPEED_NUDGE
            self._turn(way, time)

    def reconsider(self, time: float, struck: bool = False) -> None:
        """Leave a bearing that no longer holds, because a force has jumped; or take the way of a shock that has
        `struck` the crank, which is an event of its own."""
        if struck:
            self._bearing = ""
            if self._static:
                self._turn(math.copysign(1.0, self._run.state[self._omega]))
            self._settle_loop(time)
        elif self._bearing == "stuck" and abs(torque := self._run.motor_torque(time)) > self._static:
            self._leave(time, math.copysign(1.0, torque))

    def _turn(self, way: float, time: float = 0.0) -> None:
        self._enter({1.0: "forward", -1.0: "backward", 0.0: "free"}[way], 1.0, way, time)

    def _enter(self, bearing: str, turns: float, way: float, time: float) -> None:
        self._run.set_parameter("turns", turns)
        self._run.set_parameter("bearing", way)
        if self._bearing not in ("", bearing):
            self._run.add_event(time, "crank_stops" if bearing == "stuck" else "crank_turns")
        self._bearing = bearing

    def _cross_limit(self, time: float, limit: float) -> None:
        """Change the state of the current loop, whose guard is put on the new side of zero."""
        before = self._limit
        self._enter_limit(limit)
        wanted = self._run.wanted_voltage(time)
        if limit:
            guard = limit * wanted - self._supply
        else:
            guard = self._supply - before * wanted
        self._run.set_parameter("loop_offset", _VOLTAGE_NUDGE - guard)

    def _enter_limit(self, limit: float) -> None:
        self._limit = limit
        for name, value in (("within", 0.0 if limit else 1.0), ("limit", limit), ("loop_offset", 0.0)):
            self._run.set_parameter(name, value)

    def driven(self, times: np.ndarray, points: np.ndarray) -> np.ndarray:
        """theta, theta', V, i at the states `points`, and nothing for theta'', shape (n, 5).

        Voltage and current follow from the state alone, for voltage and current are continuous where the current loop
        meets a limit.
        """
        scene, found = self._scene, np.zeros((len(times), 5))
        found[:, :2] = points[:, self._theta:self._theta + 2]
        resistance, inductance = scene["motor.winding_resistance"], scene["motor.winding_inductance"]
        back = self._equations.constant * found[:, 1]
        current = points[:, self._theta + 2] if inductance else np.full(len(times), self._held)
        voltage = np.full(len(times), self._held)
        if self._equations.has_current_loop:
            wanted = back + resistance * current
            if inductance:
                wanted += inductance / scene["motor.current_time_constant"] * (self._held - current)
            voltage = np.clip(wanted, -self._supply, self._supply)
            current = current if inductance else np.where(wanted == voltage, current, (voltage - back) / resistance)
        elif not inductance:
            current = (voltage - back) / resistance
        found[:, 2], found[:, 3] = voltage, current
        return found

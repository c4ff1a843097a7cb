"""A robot: a scene that heyoka integrates by Taylor's method with terminal events.

heyoka finds a root wherever the polynomial of an event starts at zero. heyoka's own remedy, a cooldown, would hide a
true event that follows at once, such as the bounces that die out, or N = 0 just after an impact. Therefore cooldowns
are off, and each quantity whose guard has fired is put on its new side of zero by less than a rounding error: a depth,
a height or a speed of the body by a nudge of the state, a force by an offset of its guard.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import heyoka as hy
import numpy as np

from benchmark.heyoka_robot.contacts import Body, Plates
from benchmark.heyoka_robot.equations import Equations
from benchmark.heyoka_robot.run_state import GuardSeries, IntegrationState
from vibro_lab.accuracy.programs import COLUMNS
from vibro_ros import Scene

#: Columns of `HeyokaRun.driven`.
DRIVEN = ("crank_angle", "motor_speed", "motor_voltage", "motor_current", "given_acceleration",
          "upper_plate_position", "upper_plate_velocity", "inclined_plate_position", "inclined_plate_velocity")
_EVENT_DTYPE = np.dtype([("time", float), ("kind", "U16"), ("speed", float), ("duration", float)])
_SAME_INSTANT = 1e-13  # s; a time of about 1 s is rounded by 1e-16
_SPEED_NUDGE = 1e-15  # rad/s
_VOLTAGE_NUDGE = 1e-12  # V


@dataclass(frozen=True)
class HeyokaRun:
    """Results of a run by heyoka; zero for coordinates that the scene does not have."""

    samples: np.ndarray  # shape (n, 8): u, u', w, w', x, x', y, y' [m, m/s], as `COLUMNS`
    # Shape (n, 9), as `DRIVEN`: theta [rad], omega [rad/s]; of a dc motor V and i [V, A], of another one omega'
    # [rad/s²]; and the plates' positions [m] and speeds [m/s], which follow from the commands alone.
    driven: np.ndarray
    # Structured, shape (events,), by time: `time` [s], `kind` (`upper_contact`, `inclined_contact`, `stick`,
    # `slip_forward`, `slip_backward`, `unloaded`, `lift_off`, `landing`, `crank_stops`, `crank_turns`), and for
    # contacts approach `speed` [m/s] and `duration` [s], infinite if they last at the end.
    events: np.ndarray


class HeyokaRobot:
    """A scene, compiled once by heyoka, to be run any number of times.

    Parameters
    ----------
    scene : Scene
        The scene to simulate.
    tolerance : float
        heyoka's tolerance of a step, relative to the largest coordinate or speed. 1e-15 is that of a double. The start
        of a body under Stribeck's friction needs 1e-18, because speeds of some 1e-10 m/s decide the start.

    Raises
    ------
    ValueError
        For a parameter that the robot does not have (`benchmark.support`).
    """

    def __init__(self, scene: Scene, tolerance: float = 1e-15):
        self.scene = scene
        equations = self._equations = Equations(scene)
        guards = equations.guards()
        self._actions: dict[str, object] = {}
        events = [self._event(name, guard) for name, guard in guards.items()]
        self._integrator = hy.taylor_adaptive(sys=equations.system, state=[0.0] * len(equations.system), tol=tolerance,
                                              t_events=events)
        self._state, self._parameters = self._integrator.state, self._integrator.pars
        self._run = IntegrationState(equations, self._state, self._parameters)
        series = GuardSeries(equations, self._state, self._parameters)
        self._body = Body(equations, self._run, series)
        self._contacts = Plates(equations, self._run, self._body, series)
        self._motor: DcMotor | GivenMotor = GivenMotor(scene, self._run)
        if equations.has_rotor:
            self._motor = motor = DcMotor(equations, self._run)
            self._body.strike_crank = lambda time: motor.reconsider(time, True)
            motor.feel_jump = self._body.reconsider if equations.linkage else lambda time: None
        self._body.feel_shock = self._contacts.feel_shock
        self._actions.update(self._contacts.actions() | self._body.actions() | self._motor.actions())

    def _event(self, name: str, guard: hy.expression) -> object:
        actions = self._actions

        def act(integrator, direction):
            actions[name](integrator.time, direction)
            self._motor.reconsider(integrator.time)
            self._contacts.release_unpressed(integrator.time)
            return self._run.short_flight == 0.0  # else heyoka stops, and goes on in short steps

        # The default cooldown serves a kink, which is next crossed half a turn later, and the end of a decay.
        if name.endswith("kink") or name == "decay":
            return hy.t_event(guard, callback=act)
        return hy.t_event(guard, callback=act, cooldown=0.0)

    def integrate(self, times: np.ndarray, commands: Iterable[tuple[float, Mapping[str, float]]] = ()) -> HeyokaRun:
        """Run from the start.

        Parameters
        ----------
        times : ndarray, shape (n,)
            Instants to sample [s], ascending, none negative.
        commands : iterable of (float, mapping)
            Instants [s], ascending, and what is commanded then: `motor_speed` [rad/s] or `motor_voltage` [V],
            `upper_gap`, `inclined_gap` [m].

        Raises
        ------
        RuntimeError
            If heyoka fails or an event was missed.
        """
        times = np.asarray(times, dtype=float)
        self._start()
        waiting, parts, driven = list(commands), [], []
        now, end, done = 0.0, float(times[-1]), 0
        while True:
            while waiting and waiting[0][0] <= now:
                self._command(now, **waiting.pop(0)[1])
            self._motor.settle(now)
            self._contacts.settle(0.0)  # all states by the motion, also where a guard is exactly zero
            self._body.settle(0.0)
            self._contacts.release_unpressed(0.0)
            self._motor.reconsider(0.0)
            stop = min([end, *(command[0] for command in waiting[:1]), self._motor.next_instant(now),
                        *(now + left for left in self._times_to_ramp_ends())])
            last = stop == end
            upto = len(times) if last else int(np.searchsorted(times, stop))
            samples, of_drives = self._advance(times[done:upto] - now, stop - now)
            parts.append(samples)
            driven.append(of_drives)
            done = upto
            if last:
                break
            self._move_time_origin(now, stop - now)
            now = stop
        return HeyokaRun(np.concatenate(parts), np.concatenate(driven), np.array(self._run.events, dtype=_EVENT_DTYPE))

    def _start(self) -> None:
        scene = self.scene
        for part in (self._run, self._body, self._contacts):
            part.reset()
        self._integrator.time = 0.0
        if self._integrator.with_events:
            self._integrator.reset_cooldowns()
        self._parameters[:] = 0.0
        self._state[:] = 0.0
        given = scene["start.state"] == "given"
        angle = scene["start.crank_angle"] if given else 0.0
        self._motor.start(angle)
        self._plates, self._goals, self._plate_speeds = dict[str, float](), dict[str, float](), dict[str, float]()
        for i, guide in enumerate(self._equations.guides):
            side = guide.side
            plate = guide.rod + scene[f"{side}.gap"] if guide.kind != "none" else 0.0
            crank = math.cos(angle - guide.angle)
            slider = scene["crank.radius"] * crank + math.sqrt(guide.rod**2 - (scene["crank.radius"] * math.sin(
                angle - guide.angle))**2)
            self._run.set_parameter(f"{side}.free", 1.0)
            self._run.set_parameter(f"{side}.sign", math.copysign(1.0, crank))
            self._plates[side] = self._goals[side] = plate
            self._set_plate(side, 0.0)
            rest = min(slider - plate, 0.0) if guide.kind != "none" else slider
            self._state[2 * i] = rest if scene["start.state"] == "rest" else -plate
            if given:
                self._state[2 * i] += scene[f"start.{side}_position"]
                self._state[2 * i + 1] = scene[f"start.{side}_velocity"]
        equations = self._equations
        if given and equations.body_moves:
            self._state[equations.body:equations.body + 2] = scene["start.body_position"], scene["start.body_velocity"]
        if given and equations.hops:
            self._state[equations.height:equations.height + 2] = (
                scene["start.body_height"], scene["start.body_vertical_velocity"])

    def _set_plate(self, side: str, speed: float) -> None:
        """Let a plate move on at `speed` [m/s], without a change of the mass's own speed."""
        index = 2 * [guide.side for guide in self._equations.guides].index(side)
        self._state[index + 1] += self._plate_speeds.get(side, 0.0) - speed
        self._plate_speeds[side] = speed
        self._run.set_parameter(f"{side}.plate", self._plates[side])
        self._run.set_parameter(f"{side}.plate_speed", speed)

    def _command(self, now: float, motor_speed: float | None = None, upper_gap: float | None = None,
                 inclined_gap: float | None = None, motor_voltage: float | None = None):
        for value in (motor_speed, motor_voltage):
            if value is not None:
                self._motor.command(now, value)
        for side, gap in (("upper", upper_gap), ("inclined", inclined_gap)):
            guide = next((guide for guide in self._equations.guides if guide.side == side), None)
            if gap is not None and guide is not None and guide.kind != "none":
                self._goals[side] = guide.rod + gap
                way = np.sign(self._goals[side] - self._plates[side])
                self._set_plate(side, float(way) * self.scene["gap_actuator.speed"])

    def _times_to_ramp_ends(self) -> list[float]:
        """Times [s] from now to the end of the motion of each moving plate."""
        return [abs((self._goals[side] - self._plates[side]) / speed)
                for side, speed in self._plate_speeds.items() if speed]

    def _move_time_origin(self, now: float, later: float) -> None:
        """Move the instant `now`, from which time is counted, by `later` [s]; end the ramps that are over."""
        over = [left <= later + _SAME_INSTANT for left in self._times_to_ramp_ends()]
        moving = [side for side, speed in self._plate_speeds.items() if speed]
        self._motor.move_on(now, later)
        for side, speed in self._plate_speeds.items():
            self._plates[side] += speed * later
        for side, reached in zip(moving, over, strict=True):
            if reached:
                self._plates[side] = self._goals[side]
        for side, speed in self._plate_speeds.items():
            self._set_plate(side, 0.0 if self._plates[side] == self._goals[side] else speed)
        self._run.time_origin += later
        self._integrator.time = 0.0

    def _driven(self, t: np.ndarray, points: np.ndarray) -> np.ndarray:
        driven = np.zeros((len(t), len(DRIVEN)))
        driven[:, :5] = self._motor.driven(t, points)
        for guide in self._equations.guides:
            if guide.kind != "none":
                column = DRIVEN.index(f"{guide.side}_plate_position")
                speed = self._plate_speeds[guide.side]
                driven[:, column], driven[:, column + 1] = self._plates[guide.side] + speed * t, speed
        return driven

    def _advance(self, times: np.ndarray, stop: float) -> tuple[np.ndarray, np.ndarray]:
        """Samples and what is driven at `times` [s], which are counted as now, on the way to `stop` [s]."""
        equations, points = self._equations, self._propagate(times, stop)
        samples = np.zeros((len(times), len(COLUMNS)))
        for i, guide in enumerate(equations.guides):
            column, speed = COLUMNS.index(f"{guide.side}_position"), self._plate_speeds[guide.side]
            samples[:, column] = points[:, 2 * i] + (self._plates[guide.side] + speed * times)
            samples[:, column + 1] = points[:, 2 * i + 1] + speed
        for column, index, there in ((4, equations.body, equations.body_moves), (6, equations.height, equations.hops)):
            if there:
                samples[:, column:column + 2] = points[:, index:index + 2]
        return samples, self._driven(times, points)

    def _propagate(self, times: np.ndarray, stop: float) -> np.ndarray:
        """States at `times` [s] on the way to `stop` [s], in steps that are short during short bounces."""
        integrator, run = self._integrator, self._run
        parts, done = [], 0
        while True:
            now, flight = integrator.time, run.short_flight
            integrator.time = now  # heyoka's time has a second double, by which the grid's first instant may lie behind
            end = min(stop, now + 1.5 * flight) if flight else stop
            within = times[done:np.searchsorted(times, end, side="right")]
            leading = [now] if not len(within) or within[0] > now else []
            trailing = [end] if end > (within[-1] if len(within) else now) else []
            run.short_flight = 0.0
            outcome, *_, points = integrator.propagate_grid(
                np.concatenate([leading, within, trailing]), max_delta_t=1.5 * flight if flight else math.inf)
            parts.append(points[len(leading):len(leading) + len(within)])
            done += len(parts[-1])
            if outcome == hy.taylor_outcome.time_limit:
                if end == stop:
                    return np.concatenate(parts)
            elif not run.short_flight:
                raise RuntimeError(f"heyoka stopped with {outcome} at {run.time_origin + integrator.time:g} s")


class GivenMotor:
    """A motor whose speed follows from the commands alone: `ideal`, `ramp` or `lag`."""

    def __init__(self, scene: Scene, run: IntegrationState):
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
        driven = np.zeros((len(times), 5))
        driven[:, 0], driven[:, 1] = self._at(times)
        driven[:, 4] = self._change
        if self._kind == "lag":
            lag = self._scene["motor.time_constant"]
            driven[:, 4] *= -np.exp(-times / lag) / lag
        return driven

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

    def __init__(self, equations: Equations, run: IntegrationState):
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
        previous_limit = self._limit
        self._enter_limit(limit)
        wanted = self._run.wanted_voltage(time)
        if limit:
            guard = limit * wanted - self._supply
        else:
            guard = self._supply - previous_limit * wanted
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
        scene, driven = self._scene, np.zeros((len(times), 5))
        driven[:, :2] = points[:, self._theta:self._theta + 2]
        resistance, inductance = scene["motor.winding_resistance"], scene["motor.winding_inductance"]
        back = self._equations.constant * driven[:, 1]
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
        driven[:, 2], driven[:, 3] = voltage, current
        return driven

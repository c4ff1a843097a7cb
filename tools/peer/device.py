"""The peer: a scene that heyoka integrates by Taylor's method with terminal events.

heyoka finds a root wherever the polynomial of an event starts at zero. heyoka's own remedy, a cooldown, would hide a
true event that follows at once, such as the bounces that die out, or N = 0 just after an impact. Therefore cooldowns
are off, and each quantity whose guard has fired is put on its new side of zero by less than a rounding error: a depth,
a height or a speed of the body by a nudge of the state, a force by an offset of its guard.
"""

import math
import time as wall_clock
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import heyoka as hy
import numpy as np

from tools.peer.body import Body
from tools.peer.equations import Equations
from tools.peer.motor import DcMotor, GivenMotor
from tools.peer.plates import Plates
from tools.peer.run_state import RunState, Series
from vibro_ros.accuracy.methods import COLUMNS
from vibro_ros.model.scene import Scene

#: Columns of `PeerRun.driven`.
DRIVEN = ("crank_angle", "motor_speed", "motor_voltage", "motor_current", "given_acceleration",
          "upper_plate_position", "upper_plate_velocity", "inclined_plate_position", "inclined_plate_velocity")
_SAME_INSTANT = 1e-13  # s; a time of about 1 s is rounded by 1e-16
_EVENT_DTYPE = np.dtype([("time", float), ("kind", "U16"), ("speed", float), ("duration", float)])


@dataclass(frozen=True)
class PeerRun:
    """What heyoka has found in a run.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Instants [s].
    samples : ndarray, shape (n, 8)
        u, u', w, w', x, x', y, y' [m, m/s] (`COLUMNS`); zero for what the scene does not have.
    driven : ndarray, shape (n, 9)
        theta [rad], omega [rad/s]; of a dc motor V and i [V, A], of another one omega' [rad/s²], which follows from the
        commands alone as the plates' positions [m] and speeds [m/s] do (`DRIVEN`); zero for what the scene does not
        have.
    events : structured ndarray, shape (events,)
        By time: `time` [s], `kind` (`upper_contact`, `inclined_contact`, `stick`, `slip_forward`, `slip_backward`,
        `unloaded`, `lift_off`, `landing`, `crank_stops`, `crank_turns`), and for contacts approach `speed` [m/s] and
        `duration` [s], infinite if they last at the end.
    steps : int
        Taylor steps.
    wall_time : float
        Seconds that the integration took, compilation excluded.
    """

    times: np.ndarray
    samples: np.ndarray
    driven: np.ndarray
    events: np.ndarray
    steps: int
    wall_time: float


class Peer:
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
        For a parameter that the peer does not have (`model.support`).
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
        self._run = RunState(equations, self._state, self._parameters)
        series = Series(equations, self._state, self._parameters)
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

    def integrate(self, times: np.ndarray, commands: Iterable[tuple[float, Mapping[str, float]]] = ()) -> PeerRun:
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
        began = wall_clock.perf_counter()
        self._start()
        waiting, parts, driven, steps = list(commands), [], [], 0
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
            samples, of_drives, taken = self._advance(times[done:upto] - now, stop - now)
            parts.append(samples)
            driven.append(of_drives)
            steps, done = steps + taken, upto
            if last:
                break
            self._move_time_origin(now, stop - now)
            now = stop
        wall_time = wall_clock.perf_counter() - began
        found = np.array(self._run.events, dtype=_EVENT_DTYPE)
        return PeerRun(times, np.concatenate(parts), np.concatenate(driven), found, steps, wall_time)

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
        found = np.zeros((len(t), len(DRIVEN)))
        found[:, :5] = self._motor.driven(t, points)
        for guide in self._equations.guides:
            if guide.kind != "none":
                column = DRIVEN.index(f"{guide.side}_plate_position")
                speed = self._plate_speeds[guide.side]
                found[:, column], found[:, column + 1] = self._plates[guide.side] + speed * t, speed
        return found

    def _advance(self, times: np.ndarray, stop: float) -> tuple[np.ndarray, np.ndarray, int]:
        """Samples and what is driven at `times` [s], which are counted as now, and the number of steps to `stop` [s].
        """
        equations, (points, steps) = self._equations, self._propagate(times, stop)
        samples = np.zeros((len(times), len(COLUMNS)))
        for i, guide in enumerate(equations.guides):
            column, speed = COLUMNS.index(f"{guide.side}_position"), self._plate_speeds[guide.side]
            samples[:, column] = points[:, 2 * i] + (self._plates[guide.side] + speed * times)
            samples[:, column + 1] = points[:, 2 * i + 1] + speed
        for column, index, there in ((4, equations.body, equations.body_moves), (6, equations.height, equations.hops)):
            if there:
                samples[:, column:column + 2] = points[:, index:index + 2]
        return samples, self._driven(times, points), steps

    def _propagate(self, times: np.ndarray, stop: float) -> tuple[np.ndarray, int]:
        """States at `times` [s] and the number of steps to `stop` [s], which are short during short bounces."""
        integrator, run = self._integrator, self._run
        parts, found, steps = [], 0, 0
        while True:
            now, flight = integrator.time, run.short_flight
            integrator.time = now  # heyoka's time has a second double, by which the grid's first instant may lie behind
            end = min(stop, now + 1.5 * flight) if flight else stop
            within = times[found:np.searchsorted(times, end, side="right")]
            before = [now] if not len(within) or within[0] > now else []
            after = [end] if end > (within[-1] if len(within) else now) else []
            run.short_flight = 0.0
            outcome, _, _, taken, *_, points = integrator.propagate_grid(
                np.concatenate([before, within, after]), max_delta_t=1.5 * flight if flight else math.inf)
            parts.append(points[len(before):len(before) + len(within)])
            steps, found = steps + taken, found + len(parts[-1])
            if outcome == hy.taylor_outcome.time_limit:
                if end == stop:
                    return np.concatenate(parts), steps
            elif not run.short_flight:
                raise RuntimeError(f"heyoka stopped with {outcome} at {run.time_origin + integrator.time:g} s")

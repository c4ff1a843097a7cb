"""Measures of a run of a scene from a start: each one defined once, with its unit and its meaning."""

import difflib
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vibro_lab.orbits.chaos import exponent_of_pairs, half_interval
from vibro_lab.orbits.recurrence import LEAST_WATCHED, LONGEST_PERIOD, SettledMotion, motion_of, period_in
from vibro_lab.orbits.starts import STARTING, drawn_start
from vibro_lab.orbits.turn_map import TURN, TurnMap, share_of_turn
from vibro_ros import LATEST_TIME, Samples, Scene, Simulator, Value

#: Largest number of turns [-] of one window; doubles count them exactly, and such a run takes hours.
MOST_TURNS = 1e9
# Part of a turn by which rounding may shorten a duration of whole turns.
_ROUNDING = 1e-9
_DRIFT = 0.01  # drift that is ignored, as a part of the mean speed


@dataclass(frozen=True)
class Window:
    """Time interval of a measurement, which is a whole number of turns if possible."""

    begin: float  # its first instant [s]
    # Duration of a turn [s]: at the scene's motor speed, or for a dc motor the mean; infinite if the motor stands.
    turn: float
    turns: int  # whole turns of the window; 0 if the motor stands or turns less than once
    duration: float  # its length [s]: that of the turns, or the given duration if there is no whole turn
    ends: tuple[float, ...] = ()  # instants [s] at which the turns of a dc motor end

    @property
    def end(self) -> float:
        """Its last instant [s]."""
        return self.begin + self.duration


def window(scene: Scene, settling: float, duration: float) -> Window:
    """Return the window of the most whole turns within `duration` [s], after `settling` [s].

    The body's speed oscillates within a turn, so a mean over an incomplete turn would be biased.
    """
    turn = TURN / abs(scene["motor.speed"]) if scene["motor.speed"] else math.inf
    turns = math.floor(min(duration / turn + _ROUNDING, MOST_TURNS))
    return Window(settling, turn, turns, turns * turn if turns else duration)


def _window_of_dc_motor(device: Simulator, duration: float) -> Window:
    """Advance a device over the forward turns of its dc motor's crank within `duration` [s], and return their window.
    """
    begin, turn, ends = device.time, device.state.crank_angle / TURN, list[float]()
    whole = math.floor(turn)
    while device.advance_to_angle(whole + len(ends) + 1, (turn - whole) * TURN, begin + duration):
        ends.append(device.time)
    if not ends:
        return Window(begin, math.inf, 0, duration)
    return Window(begin, (ends[-1] - begin) / len(ends), len(ends), ends[-1] - begin, tuple(ends))


def checked_times(settling: float, duration: float, drawn_start: bool) -> None:
    """Check settling and measuring time of a measurement [s]; a random start alone takes `STARTING` seconds."""
    least = STARTING if drawn_start else 0.0
    if not least <= settling <= LATEST_TIME:
        reason = f" (a drawn start takes {STARTING:g} s)" if drawn_start else ""
        raise ValueError(f"settling: {settling:g} s is out of range; give a number from {least:g} to {LATEST_TIME:g} s"
                         f"{reason}")
    if not (0.0 < duration <= LATEST_TIME - settling):
        raise ValueError(f"duration: {duration:g} s is out of range; give a number above 0, at most "
                         f"{LATEST_TIME - settling:g} s")


_STICK_EVENTS, _MOVING_EVENTS = ("stick",), ("slip_forward", "slip_backward", "unloaded", "lift_off")
_NEUTRAL_EVENTS = ("loaded", "landing")


def standing_and_airborne(device: Simulator, checkpoint: np.ndarray | None, begin_state: Samples[float],
                          events: np.ndarray, end: float) -> tuple[float, float]:
    """Times [s] during which the body stood still on the ground (NaN without a checkpoint), and was in the air.

    `checkpoint` and `begin_state` are those of the first instant; `events` happened from then on to `end` [s]. The
    device is left at some instant of the measuring time if an event does not determine whether the body sticks or slips
    after it, because the speed is then sampled.
    """
    events = events[np.isin(events["kind"], (*_STICK_EVENTS, *_MOVING_EVENTS, *_NEUTRAL_EVENTS))]
    events = events[np.argsort(events["time"], kind="stable")]
    # Begin with an artificial event that gives the body's state, in the air or on the ground, at the first instant.
    in_air = events["kind"][0] == "landing" if len(events) else begin_state.body_height > 0.0
    kinds = np.concatenate([["lift_off" if in_air else "loaded"], events["kind"]])
    times = np.concatenate([[begin_state.time], events["time"], [end]])
    lengths = np.maximum(np.diff(times), 0.0)
    airborne = float(lengths[kinds == "lift_off"].sum())
    if checkpoint is None:
        return math.nan, airborne
    stands = np.isin(kinds, _STICK_EVENTS)
    undetermined = np.flatnonzero(np.isin(kinds, _NEUTRAL_EVENTS) & (lengths > 0.0))
    if len(undetermined):
        device.restore(checkpoint)
        middles = times[undetermined] + lengths[undetermined] / 2.0
        stands[undetermined] = device.sample(np.maximum(middles, begin_state.time)).body_velocity == 0.0
    return float(lengths[stands].sum()), airborne


#: Kinds of data that `observe` gathers on request, beside displacement, turns and impacts.
WORK, REST, LOAD, MOTION = "work", "rest", "load", "motion"
#: Least and largest number of cuts from which a motion is identified, and their crank angle [rad], at which both
#: sliders are far from the plates.
LEAST_CUTS, MOST_CUTS, PHASE = 4, LEAST_WATCHED, math.pi
# Samples per turn of N, and turns whose samples are in memory at a time.
_LOADS_PER_TURN, _TURNS_AT_ONCE = 1024, 64


@dataclass(frozen=True)
class Observation:
    """Data gathered during the measuring time."""

    scene: Scene  # scene that was simulated
    window: Window  # the measuring time
    displacement: float  # displacement of the body [m], forward positive
    turns: float  # turns of the crank [-]
    # Whether the motor turned and had its commanded speed at the first and the last instant; for a dc motor, whether it
    # made at least one turn.
    steady: bool
    events: np.ndarray  # shape (n,): events that ended in the measuring time, from `Simulator.take_events`
    # Work of the motor while its power was positive, and while it was negative, both >= 0 [J]; NaN unless requested,
    # and by a method of fixed step, which keeps no accounts.
    delivered: float
    taken_back: float
    supplied: float  # the same for energy from the supply of a dc motor, and heat of its winding [J]
    heated: float
    standing: float  # time [s] during which the body stood still on the ground; NaN unless requested
    airborne: float  # time [s] during which the body was in the air
    # Mean of the normal force N over the component of the weight normal to the ground, and share of the time in which N
    # is not above 0; NaN unless requested.
    mean_load: float
    unloaded_share: float
    # Shape (m, coordinates): states at the last cuts of the measuring time, at most `MOST_CUTS`, in units of the
    # machine, with the coordinates of `TurnMap`; None unless requested, and for a motor that is not steady or turns
    # less than twice.
    cuts: np.ndarray | None
    # Mean speed [m/s] in the second half of all turns minus that in the first half; NaN without enough cuts.
    drift: float


def device_at_start(scene: Scene, start: int | None) -> Simulator:
    """Return a device of `scene` at the scene's own start (None), or after the random start of that number."""
    return Simulator(scene) if start is None else drawn_start(scene, start)


def observe(scene: Scene, requested: Collection[str], settling: float, duration: float, start: int | None
            ) -> Observation:
    """Run `scene` once and gather the `requested` data, any of `WORK`, `REST`, `LOAD`, `MOTION`; times as in `window`.
    """
    exact = scene["solver.method"] == "exact"
    accounts = WORK in requested and exact
    device = device_at_start(scene.with_parameters({"solver.accounts": True}) if accounts else scene, start)
    device.advance_to(settling)
    if not (scene.has_rotor and exact):
        return observed(device, requested, window(scene, settling, duration))
    checkpoint = device.checkpoint()
    measured = _window_of_dc_motor(device, duration)
    device.restore(checkpoint)
    return observed(device, requested, measured)


def observed(device: Simulator, requested: Collection[str], measured: Window) -> Observation:
    """Advance a device from the first instant of a measuring time to its end, and gather the `requested` data.

    The work is that of its `solver.accounts`.
    """
    device.take_events()
    scene, begin_state = device.scene, device.state
    checkpoint = device.checkpoint() if {REST, LOAD} & set(requested) else None
    accounts = WORK in requested and scene["solver.accounts"] and scene["solver.method"] == "exact"
    earlier = _account_energies(device) if accounts else np.full(4, math.nan)
    steady = bool(measured.ends) or begin_state.motor_speed == scene["motor.speed"] != 0.0
    cuts, drift = _cuts(device, measured) if MOTION in requested and steady else (None, math.nan)
    device.advance_to(measured.end)
    end_state, events = device.state, device.take_events()
    delivered, taken_back, supplied, heated = (_account_energies(device) - earlier if accounts else earlier).tolist()
    standing, airborne = standing_and_airborne(device, checkpoint if REST in requested else None, begin_state, events,
                                               measured.end)
    mean_load = unloaded_share = math.nan
    if LOAD in requested and checkpoint is not None:
        device.restore(checkpoint)
        mean_load, unloaded_share = loads_of(device, measured)
    return Observation(
        scene=scene, window=measured, displacement=end_state.body_position - begin_state.body_position,
        turns=abs(end_state.crank_angle - begin_state.crank_angle) / TURN,
        steady=steady and (bool(measured.ends) or end_state.motor_speed == scene["motor.speed"]), events=events,
        delivered=delivered, taken_back=taken_back, supplied=supplied, heated=heated, standing=standing,
        airborne=airborne, mean_load=mean_load, unloaded_share=unloaded_share, cuts=cuts, drift=drift)


def _cuts(device: Simulator, measured: Window) -> tuple[np.ndarray | None, float]:
    """Advance a device from the first instant of a measuring time; returns `cuts` and `drift` of an `Observation`."""
    turn_map, angle = _turn_map(device.scene.name, tuple(device.scene.parameters.items())), device.state.crank_angle
    last = measured.turns - 2
    if last < 0 or not turn_map.names:
        return None, math.nan
    half, count = last // 2, min(last + 1, MOST_CUTS)
    halves = [0, half, 2 * half]
    numbers = sorted({*halves, *range(last + 1 - count, last + 1)})
    if device.scene.has_rotor:
        first = math.ceil((angle - PHASE) / TURN)
        cuts = turn_map.cuts_at_turns(device, [first + number for number in numbers])
    else:
        ahead = share_of_turn(device.scene, angle, PHASE)
        cuts = turn_map.cuts_at_times(device, device.time + (ahead + np.array(numbers)) * turn_map.period)
    if not half:
        return cuts.states[-count:], math.nan
    places = np.searchsorted(numbers, halves)
    early, late = np.diff(cuts.positions[places]) / np.diff(cuts.times[places])
    return cuts.states[-count:], float(late - early)


@lru_cache(maxsize=1)
def _turn_map(name: str, parameters: tuple[tuple[str, Value], ...]) -> TurnMap:
    """Return the turn map of a scene; the last one is cached."""
    return TurnMap(Scene(name, dict(parameters)), PHASE)


def _account_energies(device: Simulator) -> np.ndarray:
    """Energies since t = 0 [J], shape (4,): motor work delivered and taken back; a dc motor's supply and heat, or NaN.
    """
    accounts = device.statistics["energy_accounts"]
    return np.array([accounts["motor_delivered"], accounts["motor_taken_back"], accounts.get("supply", math.nan),
                     accounts.get("copper", math.nan)])


def loads_of(device: Simulator, measured: Window) -> tuple[float, float]:
    """Advance a device from the first instant of a measuring time to its end; returns the two loads of `Observation`.

    With the rule `hop` the shocks of landings, and with `printed` the pulls of the ground, are too short to be sampled.
    There the mean follows from the vertical momentum of body and masses, whose change is the impulse of N minus that of
    the weight. `unilateral` and the misprint violate this balance, and `weight` does not use it: their N is sampled.
    """
    scene = device.scene
    weight = scene.total_mass * scene.gravity[1]
    if not weight > 0.0:
        return math.nan, math.nan
    count, length = max(measured.turns, 1), measured.turn if measured.turns else measured.duration
    begin, impulse, unloaded = _upward_momentum(scene, device.state), 0.0, 0.0
    for first in range(0, count, _TURNS_AT_ONCE):
        last = min(first + _TURNS_AT_ONCE, count)
        numbers = np.arange(first * _LOADS_PER_TURN, last * _LOADS_PER_TURN) + 0.5  # the middles of their intervals
        normal = device.sample(measured.begin + length / _LOADS_PER_TURN * numbers).normal_force
        impulse += float(normal.sum()) * length / _LOADS_PER_TURN
        unloaded += float(np.sum(normal <= 0.0)) / (count * _LOADS_PER_TURN)
    device.advance_to(measured.end)
    if scene["effects.normal_force"] in ("hop", "printed") and not scene["effects.misprint"]:
        impulse = weight * measured.duration + _upward_momentum(scene, device.state) - begin
    return impulse / measured.duration / weight, unloaded


def _upward_momentum(scene: Scene, state: Samples[float]) -> float:
    """Momentum of body and masses normal to the ground [kg m/s], without the linkage's, which is the same every turn.
    """
    return scene.total_mass * state.body_vertical_velocity + sum(
        scene[f"mass.{side}"] * scene.direction(side)[1] * getattr(state, f"{side}_velocity") for side in scene.guides)


class Measure(NamedTuple):
    """Definition of a measure."""

    unit: str  # SI unit; 1 for pure numbers
    meaning: str  # definition in one line, for users
    needs: tuple[str, ...]  # data that `observe` must gather for it
    value: Callable[[Observation], float]  # returns its value from an `Observation`


def _speed(run: Observation) -> float:
    return run.displacement / run.window.duration


def _power(run: Observation) -> float:
    return (run.delivered - run.taken_back) / run.window.duration


def _delivered_power(run: Observation) -> float:
    return run.delivered / run.window.duration


def _current_share(run: Observation) -> float:
    if not run.scene.has_rotor:
        return math.nan
    mean_square = max(run.heated, 0.0) / run.scene["motor.winding_resistance"] / run.window.duration
    return math.sqrt(mean_square) / run.scene["motor.continuous_current"]


def _ratio(over: float, under: float) -> float:
    """Return `over` / `under`; NaN if `under` is not positive, or so small that the ratio is not finite."""
    ratio = over / under if under > 0.0 else math.nan
    return ratio if math.isfinite(ratio) else math.nan


def _cost(power: float, run: Observation) -> float:
    weight = run.scene.total_mass * run.scene["gravity"]
    return _ratio(power, weight * abs(_speed(run))) if power > 0.0 else math.nan


def _impacts(side: str) -> Callable[[Observation], float]:
    return lambda run: _ratio(float(np.sum(run.events["kind"] == f"{side}_contact")), run.turns)


def _peak_force(side: str) -> Callable[[Observation], float]:
    def largest(run: Observation) -> float:
        if run.scene[f"effects.{side}_contact"] == "restitution":
            return math.nan
        return float(run.events["peak_force"][run.events["kind"] == f"{side}_contact"].max(initial=0.0))

    return largest


def _period(run: Observation) -> float:
    """Turns after which the motion repeats itself; 0 for no period, NaN if unknown."""
    if run.cuts is None or not run.steady or len(run.cuts) < LEAST_CUTS:
        return math.nan
    return float(period_in(run.cuts, run.scene))


_NO_ACCOUNTS = "NaN by a method of fixed step"
_NO_WINDING = f"NaN for another motor, and {_NO_ACCOUNTS[4:]}"
_NO_POWER = "NaN if that power is not above 0"
#: Names of the exponent and of half its 95 % interval, which is always measured with it.
LYAPUNOV = EXPONENT, SPREAD = "lyapunov_exponent", "lyapunov_spread"

#: Measures whose sign is the direction of the motion: the largest is that of the fastest robot, forwards or backwards.
DIRECTED = "mean_speed", "speed_per_power", "speed_per_delivered_power"

MEASURES: dict[str, Measure] = {
    "mean_speed": Measure("m/s", "mean speed of the body, forward positive", (), _speed),
    "mean_power": Measure("W", "mean mechanical power of the motor, less what the springs return to it; "
                          f"{_NO_ACCOUNTS}", (WORK,), _power),
    "delivered_power": Measure("W", "mean of the motor's power where it is positive: what the springs return is lost; "
                               f"{_NO_ACCOUNTS}", (WORK,), _delivered_power),
    "supply_power": Measure("W", f"mean of what the supply gives to a dc motor; {_NO_WINDING}", (WORK,),
                            lambda run: run.supplied / run.window.duration),
    "current_share": Measure("1", "rms current of a dc motor over motor.continuous_current; above 1 its winding "
                             f"overheats in the long run; {_NO_WINDING}", (WORK,), _current_share),
    "speed_per_power": Measure("m/J", f"mean_speed / mean_power, V/P; {_NO_POWER}", (WORK,),
                               lambda run: _ratio(_speed(run), _power(run))),
    "speed_per_delivered_power": Measure("m/J", f"mean_speed / delivered_power; {_NO_POWER}", (WORK,),
                                         lambda run: _ratio(_speed(run), _delivered_power(run))),
    "cost_of_transport": Measure("1", f"mean_power / (M g abs(mean_speed)); {_NO_POWER}, or the body stays where it is,"
                                 " or without gravity", (WORK,), lambda run: _cost(_power(run), run)),
    "delivered_cost_of_transport": Measure("1", "the same with delivered_power", (WORK,),
                                           lambda run: _cost(_delivered_power(run), run)),
    "upper_impacts": Measure("1", "contacts of the upper mass with its plate that ended, a turn of the crank; NaN if "
                             "the crank stands", (), _impacts("upper")),
    "inclined_impacts": Measure("1", "the same of the inclined mass", (), _impacts("inclined")),
    "upper_peak_force": Measure("N", "largest force of these contacts on the upper plate; 0 without a contact, NaN for "
                                "a rigid plate", (), _peak_force("upper")),
    "inclined_peak_force": Measure("N", "the same on the inclined plate", (), _peak_force("inclined")),
    "stick_share": Measure("1", "share of the time in which the body stands still on the ground", (REST,),
                           lambda run: run.standing / run.window.duration),
    "air_share": Measure("1", "share of the time in which the body is in the air (rule hop)", (),
                         lambda run: run.airborne / run.window.duration),
    "mean_load": Measure("1", "mean N over the weight: 1 in every steady motion on a real ground, more if the rule "
                         "unilateral holds the body down; NaN without gravity", (LOAD,),
                         lambda run: run.mean_load),
    "unloaded_share": Measure("1", f"share of {_LOADS_PER_TURN} instants a turn at which N is not above 0; NaN without "
                              "gravity", (LOAD,), lambda run: run.unloaded_share),
    "period": Measure("1", "turns of the crank after which the motion repeats itself at the end of the time, by the "
                      f"criterion of settled_motion; 0 without a period of up to {LONGEST_PERIOD} turns and up to a "
                      f"quarter of the measured turns, or if the motion has not settled; NaN if the motor stands or "
                      f"changes its commanded speed, or for less than {LEAST_CUTS + 1} turns", (MOTION,), _period),
    EXPONENT: Measure("1/s", "largest Lyapunov exponent, from pairs of runs that begin 1e-10 apart and are followed "
                      "until they are 1e-4 m apart; 0 if no pair separates, NaN for less than six turns", (),
                      lambda run: math.nan),
    SPREAD: Measure("1/s", "half of the 95 % interval of lyapunov_exponent, with which it always comes, from up to ten "
                    "parts of the time; if no pair separates, the largest exponent that could not be detected; if 0 "
                    "lies within the interval, the sign is not known", (),
                    lambda run: math.nan),
}
"""Every measure by its name."""


def checked_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of measures without repetition; the exponent is followed by its interval."""
    for name in names:
        if name not in MEASURES:
            similar = difflib.get_close_matches(name, MEASURES, n=1)
            remedy = ("separate them by spaces" if "," in name else f"did you mean {similar[0]}?" if similar else
                      f"measures are {', '.join(MEASURES)}")
            raise ValueError(f"{name or repr(name)}: no such measure; {remedy}")
    if not names:
        raise ValueError(f"measure: none named; measures are {', '.join(MEASURES)}")
    return tuple(dict.fromkeys(measured for name in names for measured in (LYAPUNOV if name in LYAPUNOV else (name,))))


def measure(scene: Scene, names: Collection[str], settling: float, duration: float,
            start: int | None = None) -> dict[str, float]:
    """Measure a scene from one start; returns the measures by name, in the order of `checked_names`.

    `duration` [s] is cut to whole turns of the crank (`window`). `start` is the number of a random start
    (`vibro_lab.orbits.starts`), equal for all scenes; None is the scene's own start.
    """
    return _measured(scene, checked_names(tuple(names)), settling, duration, start, frozenset())[0]


class MeasuredStart(NamedTuple):
    """Results of one start."""

    values: dict[str, float]  # the measures by name, as returned by `measure`
    # Motion that the start has settled to by the end of the measuring time; None if it has not settled.
    motion: SettledMotion | None
    # Mean speed [m/s] in the second half of all turns minus that in the first half; NaN for less than four turns.
    drift: float


def measure_with_motion(scene: Scene, names: Collection[str], settling: float, duration: float,
                        start: int | None) -> MeasuredStart:
    """As `measure`, and also return the motion that the start has settled to, and the drift of its speed."""
    values, run = _measured(scene, checked_names(tuple(names)), settling, duration, start, frozenset({MOTION}))
    motion = None if run.cuts is None or not run.steady else motion_of(run.cuts, _speed(run), scene)
    return MeasuredStart(values, motion, run.drift)


def drift_in(drifts: np.ndarray, speed: float) -> float:
    """Mean drift [m/s] of the starts of one attractor, or 0 if it is not significant.

    It is significant if it is larger than twice the half width of Student's 95 % interval, which chance exceeds in one
    of some hundred means of 8 starts, and larger than a hundredth of `speed` [m/s]. Periodic motions do not use it.
    """
    known = drifts[~np.isnan(drifts)]
    mean = float(known.mean()) if len(known) > 1 else 0.0
    return mean if abs(mean) > max(2.0 * half_interval(known), _DRIFT * abs(speed)) else 0.0


def _measured(scene: Scene, names: tuple[str, ...], settling: float, duration: float, start: int | None,
              needs: frozenset[str]) -> tuple[dict[str, float], Observation]:
    checked_times(settling, duration, start is not None)
    run = observe(scene, needs.union(*(MEASURES[name].needs for name in names)), settling, duration, start)
    values = {name: MEASURES[name].value(run) for name in names}
    if EXPONENT in names:
        values.update(zip(LYAPUNOV, exponent_of_pairs(
            device_at_start(scene, start), settling, run.window.duration), strict=True))
    return values, run

"""What a study sees of one run: where the body went, blows, work, rest and flight, and the states once a turn.

The device is stepped once through the measuring time. Only what is asked for is gathered.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.integrate import trapezoid

from vibro_ros.accuracy.starts import started
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.study.standing import standing_and_airborne
from vibro_ros.study.window import Window, window

#: What can be asked for beside displacement, turns and blows.
WORK, REST, TURNS = "work", "rest", "turns"
#: Most turns whose states are kept for `Observation.strobe`.
STROBED_TURNS = 64
# Samples a turn of the motor's power, and turns whose samples are in memory at a time.
_PER_TURN, _TURNS_AT_ONCE = 256, 64
_STROBED_POSITIONS = ("body_height", "upper_position", "inclined_position")
_STROBED_VELOCITIES = ("body_velocity", "body_vertical_velocity", "upper_velocity", "inclined_velocity")


@dataclass(frozen=True)
class Observation:
    """What was seen during the measuring time.

    Attributes
    ----------
    scene : Scene
        What was simulated.
    window : Window
        The measuring time.
    displacement : float
        Of the body [m], forward positive.
    turns : float
        Of the crank [-].
    steady : bool
        Whether the motor had its commanded speed from the first instant to the last, and turned.
    contacts : structured ndarray, shape (n,)
        Contacts that ended in the time, as `Simulator.take_events` gives them.
    delivered, taken_back : float
        Work of the motor while its power was positive, and while it was negative, both >= 0 [J]; NaN unless asked.
    standing, airborne : float
        Time [s] that the body stood still on the ground, and was in the air; NaN unless asked.
    strobe : ndarray, shape (n + 1, 7), or None
        Once a turn, at the last n turns: positions in crank radii, and velocities in crank radii times motor speed;
        None unless asked, and without a whole turn at the commanded speed.
    """

    scene: Scene
    window: Window
    displacement: float
    turns: float
    steady: bool
    contacts: np.ndarray
    delivered: float
    taken_back: float
    standing: float
    airborne: float
    strobe: np.ndarray | None


def device_at_start(scene: Scene, start: int | None) -> Simulator:
    """A device of `scene` at its own start (None), or after the drawn start of that number, as `started`."""
    return Simulator(scene) if start is None else started(scene, np.random.default_rng((0, start)))


def observe(scene: Scene, wanted: Collection[str], settling: float, duration: float, start: int | None) -> Observation:
    """Run `scene` once and gather what is `wanted`, of `WORK`, `REST`, `TURNS`; times [s] as `window` takes them.

    Raises
    ------
    SimulationError
        If the run cannot go on.
    """
    measured, accounts = window(scene, settling, duration), WORK in wanted and scene["solver.method"] == "exact"
    device = device_at_start(scene.with_parameters({"solver.accounts": True}) if accounts else scene, start)
    device.advance_to(measured.begin)
    device.take_events()
    before, checkpoint = device.state, device.checkpoint() if REST in wanted else None
    booked = _booked(device) if accounts else None
    delivered, taken_back, strobe = _sampled(device, measured, WORK in wanted and not accounts, TURNS in wanted)
    device.advance_to(measured.end)
    after, events = device.state, device.take_events()
    if booked is not None:
        delivered, taken_back = _booked(device) - booked
    standing = airborne = math.nan
    if checkpoint is not None:
        standing, airborne = standing_and_airborne(device, checkpoint, before, events, measured.end)
    return Observation(
        scene=scene, window=measured, displacement=after.body_position - before.body_position,
        turns=(after.crank_angle - before.crank_angle) / (2.0 * math.pi),
        steady=before.motor_speed == after.motor_speed == scene["motor.speed"] > 0.0,
        contacts=events[np.isin(events["kind"], ("upper_contact", "inclined_contact"))],
        delivered=float(delivered), taken_back=float(taken_back), standing=standing, airborne=airborne, strobe=strobe)


def _booked(device: Simulator) -> np.ndarray:
    """Work of the motor since t = 0 [J]: delivered, and taken back."""
    accounts = device.statistics["energy_accounts"]
    return np.array([accounts["motor_delivered"], accounts["motor_taken_back"]])


def _sampled(device: Simulator, measured: Window, work: bool, turns: bool) -> tuple[float, float, np.ndarray | None]:
    """Work delivered and taken back [J], and the states once a turn, as far as asked for.

    The work is that of samples, for the methods of fixed step, which keep no energy accounts.
    """
    if not (work or turns):
        return math.nan, math.nan, None
    count, length = max(measured.turns, 1), measured.turn if measured.turns else measured.duration
    per_turn, first = (_PER_TURN, 0) if work else (1, max(0, count - STROBED_TURNS))
    states: list[np.ndarray] = []
    delivered = taken_back = 0.0
    for begin in range(first, count, _TURNS_AT_ONCE):
        numbers = np.arange(begin * per_turn, min(begin + _TURNS_AT_ONCE, count) * per_turn + 1)
        samples = device.sample(np.minimum(measured.begin + length / per_turn * numbers, measured.end))
        delivered += trapezoid(np.maximum(samples.motor_power, 0.0), samples.time)
        taken_back += trapezoid(np.maximum(-samples.motor_power, 0.0), samples.time)
        states.append(_scaled_states(samples, device.scene)[per_turn if states else 0::per_turn])
    strobe = np.concatenate(states)[-STROBED_TURNS - 1:] if turns and measured.turns else None
    return (delivered, taken_back, strobe) if work else (math.nan, math.nan, strobe)


def _scaled_states(samples: Samples, scene: Scene) -> np.ndarray:
    """What repeats in a periodic motion, without unit, shape (n, 7)."""
    radius, speed = scene["crank.radius"], scene["motor.speed"] or 1.0
    return np.column_stack([*(getattr(samples, name) / radius for name in _STROBED_POSITIONS),
                            *(getattr(samples, name) / (radius * speed) for name in _STROBED_VELOCITIES)])

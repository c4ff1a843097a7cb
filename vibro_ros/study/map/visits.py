"""What a machine does in a cell of the map, when it comes there from the cell before."""

import math
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.recurrence import SettledMotion, settle
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.study.map.design import Line, MapDesign
from vibro_ros.study.measures import standing_and_airborne

PHASE = math.pi
"""Crank angle [rad] at which states are looked at: both sliders are far from the plates there."""
MOST_TURNS = 2048
"""Turns of the crank after which a start is given up that has not settled."""
UNSETTLED = -1
"""In place of the period of a start that has not settled."""
_LEAST_TURNS, _WITHOUT_PERIOD = 16, 256  # that are measured
_NOTHING = (math.nan, math.nan, math.nan, math.nan)


class Visit(NamedTuple):
    """One motion that was found.

    Attributes
    ----------
    speed_index, gap_index : int
        Cell of the grid.
    turns : int
        Turns of the crank after which it repeats itself; 0 where it does not, `UNSETTLED` where none was found.
    landings : int
        Landings within these turns; 0 without a period.
    mean_speed : float
        Of the body [m/s], forwards positive.
    cost_of_transport, stick_share, air_share : float
        As `study.measures` has them, dimensionless.
    state : tuple of float
        One state at the cut, in units of the machine; empty where none was found.
    """

    speed_index: int
    gap_index: int
    turns: int
    landings: int
    mean_speed: float
    cost_of_transport: float
    stick_share: float
    air_share: float
    state: tuple[float, ...]


def visits(design: MapDesign, line: Line) -> list[Visit]:
    """Sweep a line: each cell begins with the state that the cell before has led to, the first with the scene's own."""
    found, before = [], None
    for speed_index, gap_index in design.cells(line):
        turn_map = TurnMap(design.scene_at(speed_index, gap_index), PHASE)
        try:
            motion = _settled(turn_map, before)
            seen = motion and _measured(turn_map, motion)
        except SimulationError:
            motion = seen = None
        if motion and seen:
            before = motion.states[-1] * turn_map.units
            found.append(Visit(speed_index, gap_index, motion.turns, *seen, tuple(motion.states[-1].tolist())))
        else:
            before = None
            found.append(Visit(speed_index, gap_index, UNSETTLED, 0, *_NOTHING, ()))
    return found


def _settled(turn_map: TurnMap, before: np.ndarray | None) -> SettledMotion | None:
    """The motion that follows from a state before [m, m/s], or from the scene's own start where that cannot be."""
    stroboscope = Stroboscope(turn_map)
    try:
        if before is None:
            stroboscope.begin_as()
        else:
            stroboscope.begin(before / turn_map.units)
    except ValueError:
        stroboscope.begin_as()
    return settle(stroboscope, most=MOST_TURNS)


def _measured(turn_map: TurnMap, motion: SettledMotion) -> tuple[int, float, float, float, float]:
    """Landings, mean speed, cost of transport, and shares of the time in which the body stands and flies."""
    turns = motion.turns * math.ceil(_LEAST_TURNS / motion.turns) if motion.turns else _WITHOUT_PERIOD
    scene, duration = turn_map.scene, turns * turn_map.period
    device = Simulator(scene.with_parameters({"solver.accounts": True}))
    device.set_state(crank_angle=turn_map.phase, **dict(zip(turn_map.names, motion.states[-1] * turn_map.units,
                                                             strict=True)))
    before, checkpoint, booked = device.state, device.checkpoint(), _work(device)
    device.take_events()
    device.advance_to(duration)
    events, gone = device.take_events(), device.state.body_position - before.body_position
    power = (_work(device) - booked) / duration
    landings = round(float(np.sum(events["kind"] == "landing")) * motion.turns / turns)
    standing, airborne = standing_and_airborne(device, checkpoint, before, events, duration)
    mean_speed = gone / duration if motion.turns else motion.mean_speed
    return (landings, mean_speed, _cost(scene, power, gone / duration), standing / duration, airborne / duration)


def _work(device: Simulator) -> float:
    """Work of the motor [J] since t = 0, less what it took back."""
    accounts = device.statistics["energy_accounts"]
    return float(accounts["motor_delivered"] - accounts["motor_taken_back"])


def _cost(scene: Scene, power: float, speed: float) -> float:
    weight = scene.total_mass * scene["gravity"]
    return power / (weight * abs(speed)) if power > 0.0 and weight * abs(speed) > 0.0 else math.nan

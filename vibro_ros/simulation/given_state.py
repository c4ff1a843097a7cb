"""A state of the user's choice: what may be given, and what of it the solver needs.

Commands are no part of it: a motor that takes time and a plate go on from where they are put to where they were sent.
"""

import math
from collections.abc import Mapping

import numpy as np

from vibro_ros.model.contact import REST_SPEED
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model
from vibro_ros.solver.accounts import stored_energy as accounted_energy
from vibro_ros.solver.audit import stored_energy
from vibro_ros.solver.state import State

UNITS = {
    "body_position": "m", "body_velocity": "m/s", "body_height": "m", "body_vertical_velocity": "m/s",
    "upper_position": "m", "upper_velocity": "m/s", "inclined_position": "m", "inclined_velocity": "m/s",
    "crank_angle": "rad", "motor_speed": "rad/s", "upper_plate_position": "m", "inclined_plate_position": "m",
}
"""What may be given, fields of `Samples`, with their units; all other fields follow from these."""
LARGEST_ANGLE = 1e9
"""Crank angle [rad], beyond which an angle in double precision is coarser than 1e-7 rad."""
ROUNDING = 1e-12
"""How far [m] beyond its rigid plate a mass may be given, as a sum that was rounded; it is put on the plate."""
_LARGEST = 1e6  # [m], [m/s]: what is larger is a mistake, and its square would drown the rest
_TURN = 2.0 * math.pi


def checked_state(scene: Scene, model: Model, given: Mapping[str, object],
                  now: Mapping[str, float]) -> dict[str, float]:
    """All of `UNITS`, as `given` or else as it is `now`.

    Parameters
    ----------
    scene : Scene
        What is simulated.
    model : Model
        The scene, compiled.
    given : mapping of str to number
        By the names of `UNITS`.
    now : mapping of str to float
        All fields of the present sample.

    Raises
    ------
    ValueError
        For another name, for what is no finite number or beyond its limit, for what the scene does not have, and for a
        mass beyond a rigid plate; the message names value, limit and remedy.
    """
    for name in given:
        if name not in UNITS:
            raise ValueError(f"{name}: cannot be given; give any of {', '.join(UNITS)}")
    numbers = {name: _number(scene, name, value) for name, value in given.items()}
    for name, value in numbers.items():
        if value != 0.0 and name in _absent(model):
            raise ValueError(f"{name}: {value:g} {UNITS[name]}, but it stays 0 in this scene; leave it out, or give 0")
    state = {name: now[name] for name in UNITS} | numbers
    for side in model.forms.plates:
        if scene[f"effects.{side}_contact"] == "restitution":
            _check_rigid(state, side)
    return state


def _number(scene: Scene, name: str, value: object) -> float:
    if name == "motor_speed":
        return scene.checked_motor_speed(value)
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ValueError(f"{name}: {value!r} is no number; give one in {UNITS[name]}")
    low, high = _limits(scene, name)
    if not low <= value <= high:
        raise ValueError(f"{name}: {value:g} is out of range; give a number from {low:g} to {high:g} {UNITS[name]}")
    return float(value)


def _limits(scene: Scene, name: str) -> tuple[float, float]:
    if name == "crank_angle":
        return 0.0, LARGEST_ANGLE
    if name.endswith("plate_position"):
        return 0.0, 2.0 * scene[f"crank.{name.split('_')[0]}_rod"]  # as `Scene.checked_gap` has it
    return (0.0 if name == "body_height" else -_LARGEST), _LARGEST


def _absent(model: Model) -> set[str]:
    """What stays 0 in this scene."""
    forms = model.forms
    absent = {f"{side}_{what}" for side in ("upper", "inclined") if side not in forms.guides
              for what in ("position", "velocity")}
    absent |= {f"{side}_plate_position" for side in ("upper", "inclined") if side not in forms.plates}
    if not forms.body_moves:
        absent |= {"body_position", "body_velocity"}
    if not forms.body_hops:
        absent |= {"body_height", "body_vertical_velocity"}
    return absent


def _check_rigid(state: dict[str, float], side: str) -> None:
    mass, plate = state[f"{side}_position"], state[f"{side}_plate_position"]
    if mass > plate + ROUNDING:
        raise ValueError(f"{side}_position: {mass:.9g} m lies beyond the rigid plate at {plate:.9g} m; give at most "
                         "that")
    state[f"{side}_position"] = min(mass, plate)


def place(scene: Scene, model: Model, state: State, point: np.ndarray, values: Mapping[str, float],
          turned: bool) -> None:
    """Put everything where `values`, of `checked_state`, say, in the mode that holds there; a segment begins next.

    Parameters
    ----------
    scene, model : Scene, Model
        What is simulated.
    state : State
        Interrupted now, changed in place. The motor's speed and the plates are set, what they do next is not.
    point : ndarray, shape (channels,)
        All channels now, overwritten.
    values : mapping of str to float
        All of `UNITS`.
    turned : bool
        Whether the crank's angle is given; else it keeps its bits, which a sum of turns and an angle has lost.
    """
    before, old_mode = point.copy(), int(state.now["automaton"]["mode"][0])
    _place_coordinates(model, point, values)
    if turned:
        _place_crank(model, state, values["crank_angle"])
    state.now["drive"]["speed"] = values["motor_speed"]
    channels = model.forms.channels
    for k, side in enumerate(model.forms.plates):
        state.ramp["value"][k] = point[channels.ramp(k)] = values[f"{side}_plate_position"]
    for k, slider in enumerate(model.sliders):  # they move with the crank; the energy of the drives is theirs
        point[channels.signal(k)] = slider.position(values["crank_angle"])
    mode = _mode(scene, model, point)
    state.now["automaton"]["mode"] = mode
    _begin_contacts(model, state, point, mode)
    coordinates = 2 * channels.coordinates
    state.now["audit"]["energy"] += (stored_energy(model.system, point[:coordinates])
                                     - stored_energy(model.system, before[:coordinates]))
    if scene["solver.accounts"]:
        state.now["accounts"]["stored"] += (accounted_energy(model.system, mode, point)
                                            - accounted_energy(model.system, old_mode, before))


def _place_coordinates(model: Model, point: np.ndarray, values: Mapping[str, float]) -> None:
    forms, at = model.forms, model.forms.channels
    for i, side in enumerate(forms.guides):
        point[at.position(i)], point[at.velocity(i)] = values[f"{side}_position"], values[f"{side}_velocity"]
    if forms.body_moves:
        point[at.position(forms.body)] = values["body_position"]
        point[at.velocity(forms.body)] = values["body_velocity"]
    if forms.body_hops:
        point[at.position(forms.height)] = values["body_height"]
        point[at.velocity(forms.height)] = values["body_vertical_velocity"]


def _place_crank(model: Model, state: State, angle: float) -> None:
    drive, starts = state.now["drive"][0], model.system.signals.start
    rest = math.fmod(angle, _TURN)
    cell = min(int(np.searchsorted(starts, rest, side="right")) - 1, len(starts) - 2)
    drive["turns"], drive["cell"] = round((angle - rest) / _TURN), cell
    drive["offset"], drive["since"] = rest - starts[cell], 0.0


def _mode(scene: Scene, model: Model, point: np.ndarray) -> int:
    """Number of the mode that holds at `point`, but for what forces decide: that follows at the first event."""
    states = tuple(_contact(scene, model, side, point) for side in model.forms.plates)
    return next(number for number, mode in enumerate(model.modes)
                if mode.states == (*states, _friction(model, mode.friction, point)))


def _contact(scene: Scene, model: Model, side: str, point: np.ndarray) -> str:
    forms = model.forms
    depth, rate = (float(form @ point) for form in forms.penetration(side))
    if scene[f"effects.{side}_contact"] == "restitution":
        return "resting" if depth >= 0.0 and abs(rate) <= REST_SPEED else "open"
    if depth < 0.0 or (depth == 0.0 and rate <= 0.0):
        return "open"
    may_pull = scene["effects.adhesion"] or scene[f"{side}.plate.damping"] == 0.0
    return "closed" if may_pull or forms.plate_force(side) @ point >= 0.0 else "released"


def _friction(model: Model, state: str, point: np.ndarray) -> str:
    """The state of the friction that holds, among those of the scene; `state` is one of them."""
    forms, at = model.forms, model.forms.channels
    if forms.body_hops and (point[at.position(forms.height)] > 0.0 or point[at.velocity(forms.height)] != 0.0):
        return "airborne"
    if state == "grounded":
        return state
    speed = point[at.velocity(forms.body)] if forms.body_moves else 0.0
    return ("stick", "slip_forward", "slip_backward")[int(np.sign(speed))]


def _begin_contacts(model: Model, state: State, point: np.ndarray, mode: int) -> None:
    """Let the monitors that are on begin now: a contact that was under way has ended nowhere, and is no event."""
    for k, side in enumerate(model.forms.plates):
        if model.system.monitored[mode, k]:
            monitor = state.monitor[k]
            monitor["since"], monitor["peak"] = state.now["segment"]["start"][0], 0.0
            monitor["approach"] = model.forms.penetration(side)[1] @ point

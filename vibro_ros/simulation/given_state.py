"""States from which a segment begins: at the start, as a user gives them, and carried over to other equations.

A given state contains no commands: plates, and a motor that is not `ideal`, go on from that state to their targets.
"""

import math
from collections.abc import Mapping

import numpy as np

from vibro_ros.model.parameters import Parameter, quoted
from vibro_ros.model.scene import NUMBERS, Scene, check_parts, given_start, outside_plates
from vibro_ros.model.shock import REST_SPEED
from vibro_ros.model.tables import Model
from vibro_ros.solver.energy import stored_on_accounts
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.rotor import start_rotor
from vibro_ros.solver.segment import read_signals
from vibro_ros.solver.state import State, new_state
from vibro_ros.solver.system import form_value
from vibro_ros.solver.taylor import read_rotor

UNITS = {name: number.unit for name, number in NUMBERS.items()} | {
    "motor_speed": "rad/s", "upper_plate_position": "m", "inclined_plate_position": "m"}
"""Fields of `Samples` that may be given, with their units; all other fields follow from these."""
OF_DC_MOTOR = {"motor_current": "A", "controller_integral": "V or A"}
"""Numbers that may also be given for a dc motor: the current of a winding with inductance, and the controller's
integral, in the unit of the voltage or current that the controller sets."""
STATE_UNITS = UNITS | OF_DC_MOTOR
"""All numbers that may be given, with their units."""
_LARGEST_OF_DC_MOTOR = 1e6  # A, or V
_TURN = 2.0 * math.pi


def started(scene: Scene, model: Model, point: np.ndarray) -> State:
    """Return the solver's state at t = 0, before its first segment; the channels in `point` become those of the start.
    """
    system, forms, channels = model.system, model.forms, model.forms.channels
    plates = {side: scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] for side in forms.plates}
    state = new_state(system, 0.0 if forms.has_rotor else scene["motor.speed"],
                      np.array([plates[side] for side in forms.plates]), model.initial_mode)
    point[:], point[channels.one] = 0.0, 1.0
    tables = model.laid.layout, Laid(state).layout
    if forms.has_rotor:
        start_rotor(system, state, scene[scene.motor_command.replace("_", ".")])
    if scene["start.state"] == "given":
        set_point(scene, model, state, point, given_start(scene) | {"motor_speed": scene["motor.speed"]}, turned=True)
    else:
        # The sliders have the same bits as in the flow, because a mass at rest on its slider must feel no force at all.
        sliders = point[channels.signal(0):channels.signal(len(model.sliders))]
        if forms.has_rotor:
            point[channels.velocity(forms.phase)] = scene["motor.speed"]
            read_rotor(*tables, point)
            state.now["automaton"]["mode"] = _first_mode(model, point)
        else:
            read_signals(*tables, sliders)
        _set_slider_rates(model, point, 0.0, scene["motor.speed"])
        point[channels.ramp(0):channels.ramp(channels.ramps)] = state.ramp["value"]
        if scene["start.state"] == "rest":
            for i, side in enumerate(forms.guides):
                point[i] = min(sliders[i], plates.get(side, math.inf))
    if scene["solver.accounts"]:
        state.now["accounts"]["stored"] = stored_on_accounts(system, int(state.now["automaton"]["mode"][0]), point)
    return state


def checked_state(scene: Scene, given: Mapping[str, object], now: Mapping[str, float]) -> dict[str, float]:
    """Return all numbers of `UNITS`, `given` or else as they are `now`, and the given ones of `OF_DC_MOTOR`.

    ValueError for no number, an unknown name, a number that is not finite or beyond its limit, a part that the scene
    does not have, and a mass too deep in a plate.
    """
    if not given:
        raise ValueError(f"a state: no number is given; give any of {', '.join(STATE_UNITS)}")
    for name in given:
        if name not in STATE_UNITS:
            raise ValueError(f"{quoted(name)}: cannot be given; give any of {', '.join(STATE_UNITS)}")
    numbers = {name: _number(scene, name, value) for name, value in given.items()}
    check_parts(scene, numbers)
    placed = [side for side in scene.plates if {f"{side}_position", f"{side}_plate_position"} & given.keys()]
    return outside_plates(scene, {name: now[name] for name in UNITS} | numbers, placed=placed)


def _number(scene: Scene, name: str, value: object) -> float:
    if name == "motor_speed":
        return scene.checked_motor_speed(value)
    if name in OF_DC_MOTOR:
        if name not in motor_coordinates(scene):
            raise ValueError(f"{name}: {quoted(value)} is no part of this motor's state; leave it out, or choose "
                             f"effects.motor dc with {_NEEDED[name]}")
        return Parameter(name, 0.0, OF_DC_MOTOR[name], "of the motor", minimum=-_LARGEST_OF_DC_MOTOR,
                         maximum=_LARGEST_OF_DC_MOTOR).checked(value)
    if name in NUMBERS:
        return NUMBERS[name].checked(value)
    longest = 2.0 * scene[f"crank.{name.split('_')[0]}_rod"]  # as `Scene.checked_gap` has it
    return Parameter(name, 0.0, UNITS[name], "where a plate stands", minimum=0.0, maximum=longest).checked(value)


_NEEDED = {"motor_current": "a motor.winding_inductance above 0",
           "controller_integral": "motor.control speed_by_voltage or speed_by_current"}


def motor_coordinates(scene: Scene) -> tuple[str, ...]:
    """Return the names of `OF_DC_MOTOR` that the state of a scene's motor has."""
    if not scene.has_rotor:
        return ()
    return (*["motor_current"] * (scene["motor.winding_inductance"] > 0.0),
            *["controller_integral"] * (scene["motor.control"] != "voltage"))


def set_point(scene: Scene, model: Model, state: State, point: np.ndarray, values: Mapping[str, float],
              turned: bool) -> None:
    """Set positions, velocities and the mode to those of `values`; the caller begins a segment next.

    The interrupted `state` and its channels `point` are changed. The plates' positions are set, but not the next motion
    of plates and motor. `values` are all numbers of `UNITS`, and `motor_current`, if it is given. `turned` says whether
    the crank's angle is given; else the angle keeps its bits, some of which are lost in `crank_angle`, the sum of turns
    and angle.
    """
    forms, at = model.forms, model.forms.channels
    for i, side in enumerate(forms.guides):
        point[at.position(i)], point[at.velocity(i)] = values[f"{side}_position"], values[f"{side}_velocity"]
    if forms.body_moves:
        point[at.position(forms.body)] = values["body_position"]
        point[at.velocity(forms.body)] = values["body_velocity"]
    if forms.body_hops:
        point[at.position(forms.height)] = values["body_height"]
        point[at.velocity(forms.height)] = values["body_vertical_velocity"]
    if forms.has_rotor:
        point[at.velocity(forms.phase)] = values["motor_speed"]
        if "motor_current" in values:
            point[at.velocity(forms.charge)] = values["motor_current"]
    angle = values["crank_angle"]
    if turned:
        _set_crank_angle(model, state, point, angle)
    for k, side in enumerate(forms.plates):
        state.ramp["value"][k] = point[at.ramp(k)] = values[f"{side}_plate_position"]
    for k, slider in enumerate(model.sliders):  # sliders move with the crank, and decide the drives' energy
        point[at.signal(k)] = slider.position(angle)
    _set_slider_rates(model, point, angle, values["motor_speed"])
    mode = _mode_at(scene, model, point)
    state.now["automaton"]["mode"] = mode
    for k, side in enumerate(forms.plates):
        if model.system.monitors.active[mode, k]:  # a contact that was in progress is no event
            monitor = state.monitor[k]
            monitor["since"], monitor["peak"] = state.now["segment"]["start"][0], 0.0
            monitor["approach"] = form_value(forms.penetration(side)[1], point)


def _set_crank_angle(model: Model, state: State, point: np.ndarray, angle: float) -> None:
    """Set the crank's `angle` [rad]: in the clock of its drive or, if the angle is a coordinate, in `point`."""
    drive, rest = state.now["drive"][0], math.fmod(angle, _TURN)
    drive["turns"] = round((angle - rest) / _TURN)
    if model.forms.has_rotor:
        point[model.forms.channels.position(model.forms.phase)] = rest
        return
    if rest < 0.0:
        drive["turns"], rest = drive["turns"] - 1, rest + _TURN
    starts = model.system.signals.start
    drive["cell"] = cell = min(int(np.searchsorted(starts, rest, side="right")) - 1, len(starts) - 2)
    drive["offset"] = rest - starts[cell] if drive["direction"] > 0 else starts[cell + 1] - rest


def _set_slider_rates(model: Model, point: np.ndarray, angle: float, speed: float) -> None:
    """Set the speeds of the signals [m/s], which decide the energy of the linkage's masses."""
    for k, slider in enumerate(model.sliders):
        point[model.forms.channels.signal_rate(k)] = slider.slope(angle) * speed


def book_given_state(scene: Scene, model: Model, state: State, old_point: np.ndarray, old_mode: int,
                     point: np.ndarray) -> None:
    """Exclude from the accounts of `state` the change of stored energy from `old_point`, in `old_mode`, to `point`."""
    if scene["solver.accounts"]:
        mode = int(state.now["automaton"]["mode"][0])
        state.now["accounts"]["stored"] += (stored_on_accounts(model.system, mode, point)
                                            - stored_on_accounts(model.system, old_mode, old_point))


def _mode_at(scene: Scene, model: Model, point: np.ndarray) -> int:
    """Return the number of the mode at `point`; states that forces decide may be corrected at the first event."""
    contacts = tuple(_contact_state(scene, model, side, point) for side in model.forms.plates)
    motor = _motor_states(model, point) if model.forms.has_rotor else ("", "")
    return next(number for number, mode in enumerate(model.modes)
                if mode.motor == motor and mode.states[:len(contacts)] == contacts
                and mode.ground == _ground_state(model, point, has_friction=mode.ground != "grounded"))


def _first_mode(model: Model, point: np.ndarray) -> int:
    """Return the number of the mode in which a run starts: open plates, and the bearing by the speed in `point`."""
    first, motor = model.modes[model.initial_mode].states, _motor_states(model, point)
    states = (*first[:len(model.forms.plates)], *filter(None, motor), first[-1])
    return next(number for number, mode in enumerate(model.modes) if mode.states == states)


def _motor_states(model: Model, point: np.ndarray) -> tuple[str, str]:
    """Return the states of bearing and current loop by the crank's speed; the loop within its limits if it has any."""
    states = sorted({mode.motor for mode in model.modes}, key=lambda motor: motor[1] != "within_limits")
    return next(motor for motor in states if motor[0] in (_bearing_state(model, point), "turns"))


def _bearing_state(model: Model, point: np.ndarray) -> str:
    """Return the state of a bearing with friction by the crank's speed."""
    speed = point[model.forms.channels.velocity(model.forms.phase)]
    return ("stuck", "turns_forward", "turns_backward")[int(np.sign(speed))]


def _contact_state(scene: Scene, model: Model, side: str, point: np.ndarray) -> str:
    forms = model.forms
    depth, rate = (float(form_value(form, point)) for form in forms.penetration(side))
    if scene[f"effects.{side}_contact"] == "restitution":
        return "resting" if depth >= 0.0 and abs(rate) <= REST_SPEED else "open"
    if depth < 0.0 or (depth == 0.0 and rate <= 0.0):
        return "open"
    may_pull = scene["effects.adhesion"] or scene[f"{side}.plate.damping"] == 0.0
    return "closed" if may_pull or form_value(forms.plate_force(side), point) >= 0.0 else "released"


def _ground_state(model: Model, point: np.ndarray, has_friction: bool) -> str:
    forms, at = model.forms, model.forms.channels
    if forms.body_hops and (point[at.position(forms.height)] > 0.0 or point[at.velocity(forms.height)] != 0.0):
        return "airborne"
    return _sliding_state(model, point) if has_friction else "grounded"


def _sliding_state(model: Model, point: np.ndarray) -> str:
    """Return the state of a body on ground with friction by the body's speed."""
    forms = model.forms
    speed = point[forms.channels.velocity(forms.body)] if forms.body_moves else 0.0
    return ("stick", "slip_forward", "slip_backward")[int(np.sign(speed))]


def carried_over(model: Model, state: State, point: np.ndarray, new_model: Model) -> tuple[State, np.ndarray]:
    """Return state and channels of `new_model` that continue `state` and `point` of `model` at a segment's end.

    The scenes of the two models differ only in friction coefficients, pushes and numbers of the motor, so that
    coordinates, sliders and plates are the same. The states of the ground may differ, because a coefficient of 0 has
    no states of friction. A state that does not hold any more, such as sticking, is left at the first event.
    """
    old = model.modes[int(state.now["automaton"]["mode"][0])]
    contacts = old.states[:len(model.forms.plates)]
    bearing = _bearing_state(model, point) if model.forms.has_rotor else ""
    new_mode = next(number for ground in (old.ground, _sliding_state(model, point), "grounded")
                    for turning in (old.motor[0], bearing, "turns")
                    for number, mode in enumerate(new_model.modes) if mode.ground == ground
                    and mode.states[:len(contacts)] == contacts and mode.motor == (turning, old.motor[1]))
    new = new_state(new_model.system, 0.0, state.ramp["value"], new_mode)._replace(lowpass=state.lowpass)
    for name in ("now", "ramp", "monitor"):
        getattr(new, name)[...] = getattr(state, name)
    new.now["automaton"]["mode"] = new_mode
    channels, new_point = new_model.forms.channels, np.zeros(new_model.forms.channels.count)
    kept = channels.ramp_rate(channels.ramps)  # later channels are set when the segment begins
    new_point[:kept] = point[:kept]
    return new, new_point

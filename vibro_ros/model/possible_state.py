"""Which states a scene can be in: the limits of each number, the parts that a scene lacks, and rigid plates.

The scene's own start and `Simulator.set_state` ask here, so that both refuse the same.
"""

from collections.abc import Mapping
from dataclasses import replace

from vibro_ros.model.parameter_values import ParameterValues
from vibro_ros.model.parameters import BY_NAME, Parameter

PREFIX = "start."
"""Of the parameters of a given start, before the name of a field of `Samples`."""
NUMBERS: Mapping[str, Parameter] = {
    name.removeprefix(PREFIX): replace(parameter, name=name.removeprefix(PREFIX), negligible=0.0)
    for name, parameter in BY_NAME.items() if name.startswith(PREFIX) and isinstance(parameter.default, float)}
"""What may be given of a state besides motor speed and plates: fields of `Samples`, with unit and limits."""
ROUNDING = 1e-12
"""How far [m] beyond its rigid plate a mass may be given, as a sum that was rounded; it is put on the plate."""


def given_start(values: ParameterValues) -> dict[str, float]:
    """The state at t = 0 of a scene whose `start.state` is `given`, with the plates' positions [m].

    Raises
    ------
    ValueError
        For a state that cannot be; the message names the parameter, its value, the limit and the remedy.
    """
    numbers = {name: values[f"{PREFIX}{name}"] for name in NUMBERS}
    check_parts(values, numbers, PREFIX)
    plates = {f"{side}_plate_position": values[f"crank.{side}_rod"] + values[f"{side}.gap"] if side in values.plates
              else 0.0 for side in ("upper", "inclined")}
    return outside_plates(values, numbers | plates, PREFIX)


def check_parts(values: ParameterValues, given: Mapping[str, float], prefix: str = "") -> None:
    """Refuse a number that is not 0 of a part that the scene does not have.

    Parameters
    ----------
    values : ParameterValues
        The scene.
    given : mapping of str to float
        Some fields of a state, in their units.
    prefix : str
        What stands before a field's name in the message.

    Raises
    ------
    ValueError
        With the value and the remedy.
    """
    absent = _absent(values)
    for name, value in given.items():
        if value != 0.0 and name in absent:
            unit = NUMBERS[name].unit if name in NUMBERS else "m"
            raise ValueError(f"{prefix}{name}: {value:g} {unit}, but it stays 0 in this scene; leave it out, or give 0")


def _absent(values: ParameterValues) -> set[str]:
    """What stays 0 in this scene."""
    absent = {f"{side}_{what}" for side in ("upper", "inclined") if side not in values.guides
              for what in ("position", "velocity")}
    absent |= {f"{side}_plate_position" for side in ("upper", "inclined") if side not in values.plates}
    if not values.body_moves:
        absent |= {"body_position", "body_velocity"}
    if not values.body_hops:
        absent |= {"body_height", "body_vertical_velocity"}
    return absent


def outside_plates(values: ParameterValues, state: Mapping[str, float], prefix: str = "") -> dict[str, float]:
    """The state with a mass that only rounding has put beyond its rigid plate on that plate.

    Parameters
    ----------
    values : ParameterValues
        The scene.
    state : mapping of str to float
        Positions of masses and plates [m], and more.
    prefix : str
        What stands before a field's name in the message.

    Raises
    ------
    ValueError
        For a mass farther beyond its rigid plate than `ROUNDING`.
    """
    moved = dict(state)
    for side in values.plates:
        mass, plate = state[f"{side}_position"], state[f"{side}_plate_position"]
        if values[f"effects.{side}_contact"] != "restitution":
            continue
        if mass > plate + ROUNDING:
            raise ValueError(f"{prefix}{side}_position: {mass:.9g} m lies beyond the rigid plate at {plate:.9g} m; "
                             "give at most that")
        moved[f"{side}_position"] = min(mass, plate)
    return moved

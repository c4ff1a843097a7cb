"""What a simulation returns: the device's quantities at the instants asked for."""

from dataclasses import dataclass

import numpy as np

from vibro_ros.model.modes import OUTPUTS
from vibro_ros.model.tables import Model
from vibro_ros.solver.recording import evaluate_forms

EVENT_DTYPE = np.dtype([("time", float), ("kind", "U16"), ("speed", float), ("peak_force", float),
                        ("duration", float)])


@dataclass(frozen=True)
class Samples:
    """The device at one instant (floats) or at n instants (arrays, shape (n,)). SI units, REP-103 signs.

    Attributes
    ----------
    time : float or ndarray
        Instant [s].
    body_position, body_velocity : float or ndarray
        x [m] and x' [m/s].
    body_height, body_vertical_velocity : float or ndarray
        Height above the ground [m] and its rate [m/s]; zero but for the rule `hop`.
    upper_position, upper_velocity, inclined_position, inclined_velocity : float or ndarray
        Positions of the masses along their guides from the crank's centre, outwards positive [m], and rates [m/s].
        Zero for a mass that the scene does not have, as everything of it below.
    crank_angle, motor_speed : float or ndarray
        theta [rad], counted on over the turns, and its rate [rad/s].
    motor_power, motor_torque : float or ndarray
        Work rate [W] of the sliders on the springs, positive when it drives the robot, and the torque
        on the crank [N m] that does it.
    normal_force, friction_force : float or ndarray
        N [N], and F_fr [N] with the paper's sign: positive opposes forward motion. The force on the body is -F_fr.
    upper_drive_force, inclined_drive_force : float or ndarray
        Force on the mass by its drive spring and damper [N], outwards positive.
    upper_plate_force, inclined_plate_force : float or ndarray
        Contact force [N], compression positive.
    upper_plate_position, upper_plate_velocity, inclined_plate_position, inclined_plate_velocity : float or ndarray
        Plates along their guides [m] and rates [m/s].
    """

    time: float | np.ndarray
    body_position: float | np.ndarray
    body_velocity: float | np.ndarray
    body_height: float | np.ndarray
    body_vertical_velocity: float | np.ndarray
    upper_position: float | np.ndarray
    upper_velocity: float | np.ndarray
    inclined_position: float | np.ndarray
    inclined_velocity: float | np.ndarray
    crank_angle: float | np.ndarray
    motor_speed: float | np.ndarray
    motor_power: float | np.ndarray
    motor_torque: float | np.ndarray
    normal_force: float | np.ndarray
    friction_force: float | np.ndarray
    upper_drive_force: float | np.ndarray
    inclined_drive_force: float | np.ndarray
    upper_plate_force: float | np.ndarray
    inclined_plate_force: float | np.ndarray
    upper_plate_position: float | np.ndarray
    upper_plate_velocity: float | np.ndarray
    inclined_plate_position: float | np.ndarray
    inclined_plate_velocity: float | np.ndarray


@dataclass(frozen=True)
class Run(Samples):
    """Samples of a whole simulation, with what happened between them.

    Attributes
    ----------
    events : structured ndarray
        By time: `time` [s]; `kind`; and for the contacts `upper_contact` and `inclined_contact`, whose time is
        their first instant, approach `speed` [m/s], `peak_force` [N] and `duration` [s].
    statistics : dict
        Events by kind, `steps` (segments of the event loop), `wall_time` [s].
    """

    events: np.ndarray
    statistics: dict


def sampled_quantities(model: Model, times: np.ndarray, points: np.ndarray, modes: np.ndarray,
                       phases: np.ndarray) -> dict[str, np.ndarray]:
    """Fields of `Samples` from what the event loop sampled: arrays of their own, so that one can be kept without the
    others.

    Parameters
    ----------
    model : Model
        The compiled scene.
    times, points, modes, phases : ndarray
        As `solver.event_loop.advance` fills them.
    """
    linear = tuple(np.empty(len(times)) for _ in OUTPUTS)
    evaluate_forms(model.output, model.output_terms, modes, points, linear)
    quantities = dict(zip(OUTPUTS, linear, strict=True))
    if model.forms.pressed_only:
        quantities["normal_force"] = np.maximum(quantities["normal_force"], 0.0)
    speed = phases[:, 2].copy()
    power = np.zeros(len(times))
    for k, side in enumerate(model.forms.guides):
        power += quantities[f"{side}_drive_force"] * points[:, model.forms.channels.signal_rate(k)]
    quantities |= {
        "time": times.copy(), "crank_angle": 2.0 * np.pi * phases[:, 0] + phases[:, 1], "motor_speed": speed,
        "motor_torque": _torque(model, quantities, phases[:, 1], speed, power), "motor_power": power,
    }
    return quantities


def _torque(model: Model, quantities: dict[str, np.ndarray], phase: np.ndarray, speed: np.ndarray,
            power: np.ndarray) -> np.ndarray:
    """Torque of the drive forces on the crank [N m]: power by speed, and where it stands, by the sliders' slopes."""
    stands = speed == 0.0
    torque = power / np.where(stands, 1.0, speed)
    if stands.any():
        torque[stands] = sum(quantities[f"{side}_drive_force"][stands] * slider.slope(phase[stands])
                             for side, slider in zip(model.forms.guides, model.sliders, strict=True))
    return torque

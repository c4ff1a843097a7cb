"""A thousand scenes from the legal ranges, each held against what must be true of all of them."""

import numpy as np
from any_scene import scenarios
from hypothesis import HealthCheck, Phase, given, note, settings
from hypothesis import strategies as st

import vibro_ros
from vibro_ros.model.tables import MODE_EVENTS

ROUNDING = 2.3e-16
SAMPLES = 60
NUMBERS = ("body_position", "body_velocity", "upper_position", "upper_velocity", "inclined_position",
           "inclined_velocity", "crank_angle", "motor_speed", "motor_power", "normal_force", "friction_force",
           "upper_plate_force", "inclined_plate_force", "upper_drive_force", "inclined_drive_force",
           "upper_plate_position", "inclined_plate_position")


def run(scene, commands, end, cuts):
    """Simulator after the run, its states at `cuts` as a dict of arrays, and its events in the order they ended."""
    device = vibro_ros.Simulator(scene)
    states, pending = [], list(commands)
    for time in cuts:
        while pending and pending[0][0] <= time:
            at, wanted = pending.pop(0)
            device.advance_to(at)
            device.command(**wanted)
        device.advance_to(time)
        states.append(device.state)
    device.advance_to(end)
    rows = {name: np.array([getattr(state, name) for state in states]) for name in ("time", *NUMBERS)}
    return device, rows, device.take_events()


@settings(max_examples=1000, derandomize=True, database=None, deadline=None, phases=[Phase.generate],
          suppress_health_check=list(HealthCheck))
@given(scenarios(), st.integers(3, 20))
def test_whatever_the_scene(scenario, pieces):
    scene, commands, end = scenario
    note(f"{dict(scene.parameters)}, {commands}, {end}")
    device, rows, events = run(scene, commands, end, np.linspace(0.0, end, SAMPLES))
    check_finite(rows)
    check_events(events, end)
    check_plates(scene, device, rows)
    check_friction(scene, rows)
    check_rest(scene, rows, events)
    check_energy(scene, device, rows)
    check_cut(scene, commands, end, pieces, device)


def check_finite(rows):
    for name, values in rows.items():
        assert np.isfinite(values).all(), name


def check_events(events, end):
    """In the order in which they ended; contacts last, and neither speed nor force is negative."""
    assert (events["duration"] >= 0.0).all() and (events["time"] >= 0.0).all()
    ended = events["time"] + events["duration"]
    assert (np.diff(ended) >= -1e-14 * end).all()
    assert (ended <= end * (1.0 + 1e-14)).all()
    contact = np.char.endswith(events["kind"], "contact")
    assert (events["peak_force"][contact] >= 0.0).all()  # infinite in a rigid blow, never NaN


def check_plates(scene, device, rows):
    """No mass is beyond a rigid plate, nor beyond a compliant one that does not push. Each step rounds the place of a
    mass that a moving plate takes along, and the plate's own."""
    for side in scene.plates:
        depth = rows[f"{side}_position"] - rows[f"{side}_plate_position"]
        rounding = (16 + device.statistics["steps"]) * ROUNDING * np.abs(rows[f"{side}_plate_position"]).max()
        if scene[f"effects.{side}_contact"] == "restitution":
            assert depth.max() <= rounding, side
        if scene[f"effects.{side}_contact"] == "restitution" or not scene["effects.adhesion"]:
            assert rows[f"{side}_plate_force"].min() >= -force_rounding(scene, rows).max(), side


def force_rounding(scene, rows):
    """Rounding of the forces in a row of samples [N]: stiffness times the positions whose difference it multiplies."""
    total = scene.total_mass * scene["gravity"] * np.ones(SAMPLES)
    for side in scene.guides:
        rod = 2.0 * scene[f"crank.{side}_rod"]
        speed = rod * rows["motor_speed"].max() + np.abs(rows[f"{side}_velocity"]) + scene["gap_actuator.speed"]
        for part in ("spring", "plate"):
            total += scene[f"{side}.{part}.stiffness"] * (rod + np.abs(rows[f"{side}_position"]))
            total += scene[f"{side}.{part}.damping"] * speed
    return 64 * ROUNDING * total


def check_friction(scene, rows):
    if scene["effects.friction"] == "none":
        assert not rows["friction_force"].any()
        return
    coefficient = scene["ground.static_friction" if scene["effects.friction"] != "coulomb" else "ground.friction"]
    limit = coefficient * np.abs(rows["normal_force"])
    if scene["effects.friction"] == "stribeck":
        kinetic, speed = scene["ground.friction"], np.abs(rows["body_velocity"])
        # Of the speeds that a segment of up to a second passes through, a rounding may be missing in the exponent.
        passed = np.abs(rows["body_velocity"]).max() + limit.max() / scene.total_mass
        decayed = np.exp(np.minimum(0.0, 64 * ROUNDING * passed - speed) / scene["ground.stribeck_speed"])
        limit = (kinetic + (coefficient - kinetic) * decayed) * np.abs(rows["normal_force"])
    assert (np.abs(rows["friction_force"]) <= limit + (1.0 + coefficient) * force_rounding(scene, rows)).all()


def check_rest(scene, rows, events):
    """After a `stick` and until the next event of the friction the body stands: exactly 0, at one place."""
    changes = events[np.isin(events["kind"], MODE_EVENTS)]
    last = np.searchsorted(changes["time"], rows["time"], side="right") - 1
    for k in np.flatnonzero(changes["kind"] == "stick"):
        still = last == k
        assert not rows["body_velocity"][still].any()
        assert len(np.unique(rows["body_position"][still])) <= 1


def check_energy(scene, device, rows):
    statistics = device.statistics
    forces = force_rounding(scene, rows)
    moved = max(np.ptp(rows[f"{side}_position"]) for side in scene.guides) if scene.guides else 0.0
    # The reaction leaves the masses an inertia that is m1/M of their own: a difference, rounded in its coefficients.
    share = 4 * ROUNDING * scene.total_mass / scene["mass.body"] if scene["effects.reaction"] else 0.0
    allowed = (1e-11 + share) * statistics["energy_exchanged"]
    allowed += forces.max() * moved * max(1.0, np.sqrt(statistics["steps"]))
    # Each step rounds the place of a mass that a moving rigid plate takes along, always alike, against its spring.
    taken = sum(np.abs(rows[f"{side}_drive_force"]).max() * np.abs(rows[f"{side}_position"]).max()
                for side in scene.plates if scene[f"effects.{side}_contact"] == "restitution")
    allowed += statistics["steps"] * ROUNDING * taken
    allowed += statistics["steps"] * series_rounding(scene, device)
    assert abs(statistics["energy_residual"]) <= allowed + 4 * ROUNDING * stored_energy(scene, rows)


def series_rounding(scene, device):
    """Rounding of the work in a segment [J], however soon an event ends it: its series are rounded to their size over
    the whole of it, here the way that the weight takes a body within it from rest."""
    weight = scene.total_mass * scene["gravity"]
    half = 0.5 * min(1.0, device._model.system.longest_step.max())
    return ROUNDING * weight * 0.5 * weight / scene["mass.body"] * half**2


def stored_energy(scene, rows):
    """What the drive springs may hold [J]: a mass that is put on its plate, by a rounding, changes it by as much."""
    return sum(0.5 * scene[f"{side}.spring.stiffness"] * (scene[f"crank.{side}_rod"] + scene["crank.radius"]
                                                          + np.abs(rows[f"{side}_position"]).max()) ** 2
               for side in scene.guides)


def check_cut(scene, commands, end, pieces, device):
    """Cut up otherwise, the run ends with the same bits."""
    again, _, _ = run(scene, commands, end, np.linspace(0.0, end, pieces))
    assert again.state == device.state

"""A thousand scenes from the legal ranges, each checked for properties that hold in every scene."""

import math
from collections import Counter

import numpy as np
import pytest
from any_scene import draw_scenario
from commanded_device import booked_energy

import vibro_ros
from vibro_ros.model.modes import MODE_EVENTS
from vibro_ros.model.parameters import SCENE_PARAMETERS

ROUNDING = 2.3e-16
SAMPLES = 60
STEPS = 700
PART = 250
# Least number of the scenes of a part for which this is true: about half of the mean over the parts.
LEAST = {"effects.reaction True": 50, "effects.adhesion False": 55, "effects.mass_weight True": 60,
         "both masses": 105, "both plates": 90, "both plates rigid": 16, "in the air": 16,
         "sticks under a force": 55, "slips by coulomb": 15, "slips by static": 14, "slips by stribeck": 16,
         "crank_stops": 2, "motor_ramp_end": 6,
         "slips by weight": 14, "slips by unilateral": 13, "slips by printed": 12, "slips by hop": 4}


@pytest.mark.parametrize("first", range(0, 1000, PART))
def test_invariants_in_1000_random_scenes(first):
    """A33. Every scene has the properties; `check_coverage` requires that the situations occur often enough."""
    seen = Counter()
    for seed in range(first, first + PART):
        seen.update(check_scene(seed))
    check_coverage(seen)


def check_scene(seed):
    """Check the scene of this seed; returns what the scene has and what happened in its run."""
    rng, drawn = np.random.default_rng(seed), "while it is drawn"
    try:
        scene, commands, end = draw_scenario(rng)
        drawn = dict(scene.parameters), commands, end
        return check_scenario(scene, commands, end, rng)
    except vibro_ros.SimulationError as failure:
        if may_run_away(scene) and "no longer finite" in str(failure):
            return set()
        raise AssertionError(f"check_scene({seed}) fails: {drawn}") from failure
    except Exception as failure:
        raise AssertionError(f"check_scene({seed}) fails: {drawn}") from failure


def may_run_away(scene):
    """Whether the crank of a dc motor may turn beyond all bounds: by the rule `printed` friction pushes, and springs of
    1e8 N/m on a crank of 50 m whose inertia is 1e-6 kg m² make it turn at 1e9 rad/s."""
    if not scene.has_rotor:
        return False
    stored = sum(scene[f"{side}.spring.stiffness"] * (scene[f"crank.{side}_rod"] + scene["crank.radius"]) ** 2
                 for side in scene.guides)
    return scene["effects.normal_force"] == "printed" or stored / scene.motor_inertia > 1e8**2


def check_scenario(scene, commands, end, rng):
    """Check a run; returns what the scene has and what happened in the run."""
    cut, commands = cut_run(scene, commands, end, rng)
    end = cut.time
    device, rows, events = sampled_run(scene, commands, end)
    check_finite(rows)
    check_events(events, end)
    check_instants(events)
    check_plates(scene, device, rows)
    check_height(scene, device, rows)
    check_friction(scene, rows)
    check_rest(scene, rows, events)
    check_energy(scene, device, rows)
    assert cut.state == device.state  # cut up otherwise, the run ends with the same bits
    return traits(scene, rows, events)


def cut_run(scene, commands, end, rng):
    """Simulator after a run that stops often, and the commands that it was given.

    The run goes to `end` or to the first stop by which it has taken `STEPS` steps. From one stop to the next the time
    since the last command doubles, so that the steps are hardly ever more than twice as many.
    """
    device = vibro_ros.Simulator(scene)
    for given, until in enumerate([*(at for at, _ in commands), end]):
        fractions = 2.0 ** (rng.random() - np.arange(30.0, 0.0, -1.0))
        stops = device.time + (until - device.time) * np.repeat(fractions, 2)  # twice: to advance by nothing is a cut
        for stop in [*stops, until]:
            device.advance_to(min(stop, until))  # a sum may be rounded up
            if device._motion.steps > STEPS:
                return device, commands[:given]
        if given < len(commands):
            device.command(**commands[given][1])
    return device, commands


def sampled_run(scene, commands, end):
    """Simulator after the run, its samples as a dict of arrays, and its events in the order they ended."""
    device, times, parts = vibro_ros.Simulator(scene), np.linspace(0.0, end, SAMPLES), []
    for at, command in commands:
        parts.append(device.sample(times[(times >= device.time) & (times < at)]))
        device.advance_to(at)
        device.command(**command)
    parts.append(device.sample(times[times >= device.time]))
    rows = {name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    return device, rows, device.take_events()


def traits(scene, rows, events):
    """Return the traits of a scene and its run: which effects it has, and which events occurred."""
    choices = {name: value for name, value in scene.parameters.items() if name.startswith("effects.")}
    effects = {f"{name} {value}" for name, value in choices.items()} | set(events["kind"].tolist())
    rigid = [side for side in scene.plates if choices[f"effects.{side}_contact"] == "restitution"]
    rubs, moves = rows["friction_force"] != 0.0, rows["body_velocity"] != 0.0
    happened = {
        "both masses": len(scene.guides) == 2, "both plates": len(scene.plates) == 2,
        "both plates rigid": len(rigid) == 2, "sticks under a force": (rubs & ~moves).any(),
        f"slips by {choices['effects.friction']}": (rubs & moves).any(),
        f"slips by {choices['effects.normal_force']}": (rubs & moves).any(),
        "in the air": rows["body_height"].any(),
    }
    return effects | {name for name, true in happened.items() if true}


def check_coverage(seen):
    """Check that the situations which the other checks test are drawn and occur often enough in each part, so that each
    part may run on its own. A change of the parameter table changes the draw.
    """
    effects = [parameter for parameter in SCENE_PARAMETERS if parameter.name.startswith("effects.")]
    choices = [f"{effect.name} {choice}" for effect in effects for choice in effect.choices or (False, True)]
    kinds = [*MODE_EVENTS, "upper_contact", "inclined_contact", "gap_reached", "motor_ramp_end"]
    least = dict.fromkeys(choices, 11) | dict.fromkeys(kinds, 10) | LEAST
    assert {name: seen[name] for name, number in least.items() if seen[name] < number} == {}


def check_finite(rows):
    for name, values in rows.items():
        assert np.isfinite(values).all(), name


def check_events(events, end):
    """Check that events are in the order of their ends, that contacts last, and that no speed or force is < 0."""
    assert (events["duration"] >= 0.0).all() and (events["time"] >= 0.0).all()
    ended = events["time"] + events["duration"]
    assert (np.diff(ended) >= -1e-14 * end).all()
    assert (ended <= end * (1.0 + 1e-14)).all()
    contact = np.char.endswith(events["kind"], "contact")
    assert (events["peak_force"][contact] >= 0.0).all()  # infinite in a rigid blow, never NaN


def check_instants(events):
    """Check that no state of the body or of the crank begins twice at one instant without a shock, because it could
    then begin for ever. A shock changes the velocities. Two events of one instant have exactly the same bits of time.
    """
    shocks = events["time"][(events["kind"] == "landing") | np.isinf(events["peak_force"])]
    changes = events[np.isin(events["kind"], MODE_EVENTS) & ~np.isin(events["time"], shocks)]
    begun = Counter(zip(changes["time"].tolist(), changes["kind"].tolist(), strict=True))
    assert {instant: times for instant, times in begun.items() if times > 1} == {}


def check_plates(scene, device, rows):
    """Check that no mass is beyond a rigid plate, nor beyond a compliant plate that does not push. Each step rounds the
    position of a mass that a moving plate carries, and the plate's own.
    """
    for side in scene.plates:
        assert np.isin(np.abs(rows[f"{side}_plate_velocity"]), (0.0, scene["gap_actuator.speed"])).all(), side
        depth = rows[f"{side}_position"] - rows[f"{side}_plate_position"]
        rounding = (16 + device.statistics["steps"]) * ROUNDING * np.abs(rows[f"{side}_plate_position"]).max()
        if scene[f"effects.{side}_contact"] == "restitution":
            assert depth.max() <= rounding, side
        if scene[f"effects.{side}_contact"] == "restitution" or not scene["effects.adhesion"]:
            assert rows[f"{side}_plate_force"].min() >= -force_rounding(scene, rows).max(), side


def force_rounding(scene, rows, closed=("upper", "inclined")):
    """Rounding of the forces in a row of samples [N]: stiffness times the positions whose difference it multiplies;
    of the plates, of those that are `closed`."""
    total = scene.total_mass * scene["gravity"] + abs(scene["ground.drag"]) * np.ones(SAMPLES)
    total += scene["ground.viscous_friction"] * np.abs(rows["body_velocity"]).max()
    for part in scene.linkage:
        rod = scene.parameters.get(f"crank.{part.removesuffix('_slider')}_rod", math.inf)
        sharpness = 1.0 / math.sqrt(1.0 - (scene["crank.radius"] / rod) ** 2)  # of the slider's turn, at the most
        change = np.abs(rows["motor_speed"]).max() ** 2 * sharpness + 2.0 * motor_acceleration(scene, rows)
        total += scene[f"mass.{part}"] * scene["crank.radius"] * change
    for side in scene.guides:
        rod = 2.0 * scene[f"crank.{side}_rod"]
        speed = rod * np.abs(rows["motor_speed"]).max() + np.abs(rows[f"{side}_velocity"]) + scene["gap_actuator.speed"]
        for part in ("spring", "plate") if side in closed else ("spring",):
            total += scene[f"{side}.{part}.stiffness"] * (rod + np.abs(rows[f"{side}_position"]))
            total += scene[f"{side}.{part}.damping"] * speed
    if scene["effects.misprint"]:
        positions = np.abs(rows["upper_position"]) + np.abs(rows["inclined_position"])
        total += scene["inclined.plate.stiffness"] * positions
    return 64 * ROUNDING * total


def motor_acceleration(scene, rows):
    """Largest change of the motor's speed [rad/s²]."""
    if scene.has_rotor:
        torques = scene.motor_constant * rows["motor_current"], rows["motor_torque"], scene["motor.static_friction"]
        return sum(np.abs(torque).max() for torque in torques) / scene.motor_inertia
    return {"ideal": 0.0, "ramp": scene["motor.acceleration"],
            "lag": 2.0 * scene["motor.max_speed"] / scene["motor.time_constant"]}[scene["effects.motor"]]


def check_height(scene, device, rows):
    """Check that the body is not below the ground, and that the ground exerts no force on it in the air. The distance
    by which rounding of forces moves it within a segment is allowed: 2e-15 m in the scene `device`, more where plates
    of 1e11 N/m press on masses on guides of a kilometre.
    """
    height = rows["body_height"]
    if scene["effects.normal_force"] != "hop":
        assert not height.any() and not rows["body_vertical_velocity"].any()
        return
    steps = np.minimum(device._motion.model.system.longest_segment, 1.0)
    moved = [force_rounding(scene, rows, mode.closed).max() / scene["mass.body"] * 0.5 * step**2
             for mode, step in zip(device._motion.model.modes, steps, strict=True) if mode.ground == "airborne"]
    assert height.min() >= -max(moved, default=0.0)
    assert not rows["normal_force"][height > 0.0].any() and not rows["friction_force"][height > 0.0].any()


def check_friction(scene, rows):
    """Check that the ground pushes, and that friction obeys its law: its full value against the motion of a slipping
    body, and at most the bound for a body at rest. Only by the rule `printed` N may be negative; friction then acts
    along the motion, also on a body that starts at the instant of the sample. The N of `unilateral` is reported as 0
    where it is negative, and must then not appear in the friction either.
    """
    normal, friction, speed = rows["normal_force"], rows["friction_force"], rows["body_velocity"]
    law, rounding = scene["effects.friction"], force_rounding(scene, rows)
    if scene["effects.normal_force"] != "printed":
        assert (normal >= -rounding).all()
    if law == "none":
        assert not friction.any()
        return
    kinetic = np.where(speed < 0.0, scene.kinetic_frictions[1], scene.kinetic_frictions[0])
    static = max(scene.kinetic_frictions) if law == "coulomb" else scene["ground.static_friction"]
    rounding = (1.0 + static) * rounding
    # Speeds are rounded to the largest that a segment of up to a second passes through.
    passed = np.abs(speed).max() + static * np.abs(normal).max() / scene.total_mass
    unknown = 64 * ROUNDING * passed
    slips = np.abs(speed) > unknown
    extra, width = (static - kinetic, scene["ground.stribeck_speed"]) if law == "stribeck" else (0.0, 1.0)
    # The misread force of 1e8 N takes a body past Stribeck's speed in 1e-11 s, less than rounding leaves of a segment.
    starting = extra * np.expm1(unknown / width) * np.abs(normal) if scene["effects.misprint"] else 0.0
    assert (np.abs(friction) <= static * np.abs(normal) + rounding + starting)[~slips].all()
    if scene["effects.normal_force"] != "printed":
        assert (np.sign(speed) * friction >= -rounding)[slips].all()
    falling = extra * np.exp(-np.abs(speed) / width)
    rounding += falling * np.expm1(unknown / width) * np.abs(normal)
    expected = np.sign(speed) * (kinetic + falling) * normal
    assert (np.abs(friction - expected) <= rounding)[slips].all()


def check_rest(scene, rows, events):
    """Check that the body stands exactly still after a `stick`, until the next event of the friction."""
    changes = events[np.isin(events["kind"], MODE_EVENTS)]
    last = np.searchsorted(changes["time"], rows["time"], side="right") - 1
    sticks = np.flatnonzero(changes["kind"] == "stick")
    for k in np.unique(last[np.isin(last, sticks)]):
        still = last == k
        assert not rows["body_velocity"][still].any()
        assert len(np.unique(rows["body_position"][still])) <= 1


def check_energy(scene, device, rows):
    statistics = device.statistics
    forces = force_rounding(scene, rows)
    moved = max(np.ptp(rows[f"{side}_position"]) for side in scene.guides) if scene.guides else 0.0
    # The reaction leaves the masses an inertia that is m1/M of their own: a difference, rounded in its coefficients.
    share = 4 * ROUNDING * scene.total_mass / scene["mass.body"] if scene["effects.reaction"] else 0.0
    allowed = (1e-11 + share) * booked_energy(statistics["energy_accounts"])
    allowed += forces.max() * moved * max(1.0, np.sqrt(statistics["steps"]))
    # Each step rounds the place of a mass that a moving rigid plate takes along, always alike, against its spring.
    taken = sum(np.abs(rows[f"{side}_drive_force"]).max() * np.abs(rows[f"{side}_position"]).max()
                for side in scene.plates if scene[f"effects.{side}_contact"] == "restitution")
    allowed += statistics["steps"] * ROUNDING * taken
    allowed += statistics["steps"] * series_rounding(scene, device)
    if scene["effects.mass_weight"]:  # and that of a mass of the linkage, whose height is energy
        allowed += 4 * ROUNDING * np.sqrt(statistics["steps"]) * scene["gravity"] * sum(
            scene[f"mass.{part}"] * 2.0 * max(scene["crank.upper_rod"], scene["crank.inclined_rod"])
            for part in scene.linkage)
    if scene["effects.mass_weight"]:  # and the place of a mass that hardly moves, always alike, against its weight
        allowed += statistics["steps"] * ROUNDING * sum(
            scene[f"mass.{side}"] * scene["gravity"] * np.abs(rows[f"{side}_position"]).max() for side in scene.guides)
    # Each step rounds the place of a slider, too, now up, now down, against a spring however little its mass moves.
    allowed += 4 * ROUNDING * stored_energy(scene, rows) * max(1.0, np.sqrt(statistics["steps"]))
    if scene.has_rotor:  # and the speed of a flywheel, however heavy
        turning = scene.motor_inertia * np.abs(rows["motor_speed"]).max() ** 2
        allowed += statistics["steps"] * ROUNDING * turning
    if scene.linkage or scene["ground.slope"]:  # and the speed of a body that runs down a slope, or is shaken
        moving = 0.5 * scene.total_mass * np.abs(rows["body_velocity"]).max() ** 2
        allowed += 16 * ROUNDING * moving * np.sqrt(statistics["steps"])
    check_accounts(scene, statistics["energy_accounts"], allowed)


def check_accounts(scene, accounts, allowed):
    """Check that received energy is lost or stored, to rounding. Only the friction of eq. (6) may supply energy instead
    of dissipating it, and with the reaction `unpaid` is zero.
    """
    assert abs(accounts["residual"]) <= allowed
    taking = {"drive_dampers", "plate_dampers", "blows", "landings", "copper", "bearing"}
    taking |= {"friction"} if scene["effects.normal_force"] != "printed" and scene["ground.drag"] == 0.0 else set()
    assert all(accounts.get(name, 0.0) >= -allowed for name in ("motor_delivered", "motor_taken_back", *taking))
    assert accounts["unpaid"] == 0.0 or not scene["effects.reaction"]


def series_rounding(scene, device):
    """Rounding error of the work in a segment [J]. It does not depend on how soon an event ends the segment, because
    the series are rounded to their size over the whole segment, here the distance that the weight moves a body within
    it from rest.
    """
    weight = scene.total_mass * scene["gravity"]
    half = 0.5 * min(1.0, device._motion.model.system.longest_segment.max())
    return ROUNDING * weight * 0.5 * weight / scene["mass.body"] * half**2


def stored_energy(scene, rows):
    """Energy that the drive springs may store [J]; rounding of a mass's position on its plate scales with it."""
    return sum(0.5 * scene[f"{side}.spring.stiffness"] * (scene[f"crank.{side}_rod"] + scene["crank.radius"]
                                                          + np.abs(rows[f"{side}_position"]).max()) ** 2
               for side in scene.guides)

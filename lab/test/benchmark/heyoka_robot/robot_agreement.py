"""The exact solver and heyoka's robot side by side: motion, drives, events, and every force.

Heyoka's forces are computed by hand from its states. A force is as far off as the position that its springs feel: by
1e-4 N in a plate of 1e7 N/m, of some 1e3 N, and by 1e-8 N while the plates are free.
"""

import numpy as np
from forces_by_hand import SIDES, SampledMotion

import vibro_ros
from benchmark.heyoka_robot import COLUMNS, DRIVEN, HeyokaRobot

TOLERANCE = 1e-18  # of the fastest mass's speed, a step: a body that breaks away is at first 1e-10 times as fast
POSITION = 1e-11  # m; speeds: that times 1e4/s, a contact's angular frequency
INSTANT = 1e-11  # s
#: A dc motor's crank, which every force on the masses moves: rad, rad/s, V, A.
CRANK = {"crank_angle": 1e-9, "motor_speed": 1e-7, "motor_voltage": 1e-7, "motor_current": 1e-7}
BOUNCES_LEFT_OUT = 1e-9  # s: a body that moves with 1e-9 m/s when a mass comes to rest stops within that over (mu g)
GROWN = 1e-13  # m: what rounding of both grows to, and by which the instant differs where N falls to 0 slowly
BEFORE = 1e-8  # s before a body is unloaded, in which N falls at one rate
SHORTEST = 1e-6  # s: a contact that is looked into
POINTS = 40.0  # of a contact looked at in the time in which its vibration turns by 1 rad


def simulated(scene, times, commands):
    """Every field of `Samples` at `times`, and the events, of the exact solver."""
    device, waiting, states, events = vibro_ros.Simulator(scene), list(commands), [], []
    for time in times:
        while waiting and waiting[0][0] <= time:
            instant, change = waiting.pop(0)
            device.advance_to(instant)
            device.command(**change)
        device.advance_to(time)
        states.append(vars(device.state))
        events.append(device.take_events())
    events = np.concatenate(events)
    samples = {name: np.array([state[name] for state in states]) for name in states[0]}
    return samples, events[np.argsort(events["time"], kind="stable")]


def motion(scene, run):
    """Heyoka's motion, by the names of `Samples`."""
    return SampledMotion(scene, dict(zip(COLUMNS + DRIVEN, np.hstack([run.samples, run.driven]).T, strict=True)))


def assert_agreement(scene, duration, commands=(), position=POSITION, place=0.0):
    """Return what heyoka's robot has found.

    `position` [m] is how far off positions may be. A contact may begin and end as much off as its mass takes
    to move by `place` [m].
    """
    # A controller's samples let the current jump, to either side of which a sample of the motion may belong.
    times, robot = np.linspace(0.0, duration, 41) + 1.3e-5 * scene.has_rotor, HeyokaRobot(scene, TOLERANCE)
    contacts = robot.integrate(times, commands).events
    contacts = contacts[(contacts["duration"] > SHORTEST) & np.isfinite(contacts["duration"])]
    times = np.unique(np.concatenate([times, contacts["time"] + 0.3 * contacts["duration"]]))
    run = robot.integrate(times, commands)
    samples, events = simulated(scene, times, commands)
    moved = motion(scene, run)
    for name in (*COLUMNS, *DRIVEN):
        if name == "given_acceleration":  # which the solver does not publish
            continue
        limit = 1e4 * position if "velocity" in name else position
        if name in ("crank_angle", "motor_speed"):
            limit = 1e-12 * np.abs(moved.at[name]).max()  # the sum of some 1e4 segments
        if scene.has_rotor and name in CRANK:
            limit = CRANK[name]
        assert_close(name, times, samples[name], moved.at[name], limit)
    assert_forces_agree(times, samples, moved, position)
    pairs = {kind: assert_events_agree(kind, events, run.events, position)
             for kind in ("stick", "lift_off", "landing", "crank_stops", "crank_turns")}
    pairs["unloaded"] = assert_events_agree("unloaded", events, run.events, position, slow_falls(robot, run, commands))
    for side in SIDES:
        kind = f"{side}_contact"
        late = place / passing_speeds(side, robot, run, commands) if place else np.zeros((2, 1))
        pairs[kind] = assert_events_agree(kind, events, run.events, position, *late)
    for side in SIDES:
        assert_peaks_agree(side, robot, run, commands, *pairs[f"{side}_contact"], position)
    return run


def assert_close(name, times, actual, expected, limit):
    error = np.abs(actual - expected)
    worst = (error - limit).argmax()
    assert np.all(error <= limit), f"{name} off by {error[worst]:.1e} at {times[worst]:g} s"


def assert_events_agree(kind, ours, theirs, position, begin=0.0, end=0.0):
    """Check that both have the same events of a kind, at instants that may differ by so much [s], and return them in
    pairs.
    """
    ours, theirs = ended(ours, kind), ended(theirs, kind)
    assert len(ours) == len(theirs), kind
    if len(ours):
        instant = BOUNCES_LEFT_OUT if kind == "stick" else INSTANT
        for key, limit in (("time", instant + begin), ("speed", 1e4 * position),
                           ("duration", 2.0 * INSTANT + begin + end)):
            assert_close(f"{kind} {key}", theirs["time"], ours[key], theirs[key], limit)
    return ours, theirs


def ended(events, kind):
    """Return the events of a kind without unfinished contacts, because the solver reports a contact only at its end."""
    return events[(events["kind"] == kind) & np.isfinite(events["duration"])]


def slow_falls(robot, run, commands):
    """Time [s] in which N falls by what an error `GROWN` of the positions changes it by, where a body is unloaded."""
    times = ended(run.events, "unloaded")["time"] - BEFORE
    late, later = np.zeros(len(times)), times >= 0.0  # a body that begins unloaded was not late
    if later.any():
        moved = motion(robot.scene, robot.integrate(times[later], commands))
        error = sum(plate_error(moved, side, GROWN) for side in SIDES)
        late[later] = error * BEFORE / np.maximum(moved.forces()["normal_force"], 1e-30)
    return late


def passing_speeds(side, robot, run, commands):
    """Speeds [m/s] at which the masses pass their plates where contacts begin and end, shape (2, n)."""
    contacts = ended(run.events, f"{side}_contact")
    ends = contacts["time"] + contacts["duration"]
    times = np.unique(ends)
    leaving = motion(robot.scene, robot.integrate(times, commands)).depth(side)[1][np.searchsorted(times, ends)]
    return np.maximum(np.abs([contacts["speed"], leaving]), 1e-30)


def stiffness(scene, side, part):
    """Force [N] that an error of 1 m in a position, and of 1e4 m/s in a speed, makes in a spring with its damper."""
    return scene[f"{side}.{part}.stiffness"] + 1e4 * scene[f"{side}.{part}.damping"]


def plate_error(moved, side, position):
    """Force [N] that an error `position` [m] makes in a mass's spring and in the plate that it touches."""
    touches = moved.push(side) != 0.0
    return position * (stiffness(moved.scene, side, "spring") + stiffness(moved.scene, side, "plate") * touches)


def assert_forces_agree(times, samples, moved, position):
    """Check that forces agree within the effect of an error `position` of the positions, and of 1e4/s times that of the
    speeds.
    """
    scene, limits = moved.scene, {}
    for side in SIDES:
        limits[f"{side}_drive_force"] = position * stiffness(scene, side, "spring")
        limits[f"{side}_plate_force"] = plate_error(moved, side, position)
    forces, together = moved.forces(), sum(limits[f"{side}_plate_force"] for side in SIDES)
    decay = 0.0
    if scene["effects.friction"] == "stribeck":  # what the speed's own error makes of it
        slope = scene["ground.static_friction"] * np.abs(forces["normal_force"]) / scene["ground.stribeck_speed"]
        decay = slope * np.abs(samples["body_velocity"] - moved.at["body_velocity"])
    torque = 2.0 * scene["crank.radius"] * sum(limits[f"{side}_drive_force"] for side in SIDES)  # |ds/dθ| <= 2 l
    limits |= {"normal_force": together, "friction_force": (1.0 + max(scene.kinetic_frictions)) * together + decay,
               "motor_torque": torque, "motor_power": torque * np.abs(moved.at["motor_speed"])}
    if scene.has_rotor:  # whose speed has an error of its own
        limits["motor_power"] = limits["motor_power"] + CRANK["motor_speed"] * (torque + np.abs(forces["motor_torque"]))
    for name, limit in limits.items():
        assert_close(name, times, samples[name], forces[name], limit)


def assert_peaks_agree(side, robot, run, commands, ours, theirs, position):
    """Check the peak forces of contacts: infinite for a blow, otherwise those of heyoka's states."""
    scene, blows = robot.scene, theirs["duration"] == 0.0
    assert np.all(np.isinf(ours["peak_force"]) == blows), side
    ours, theirs = ours[~blows], theirs[~blows]
    if len(ours) == 0:
        return
    springs = [(guide, part) for guide in SIDES for part in ("spring", "plate")
               if part == "spring" or scene[f"effects.{guide}_contact"] == "compliant"]
    rate = np.sqrt(sum(scene[f"{guide}.{part}.stiffness"] / scene[f"mass.{guide}"] for guide, part in springs))
    seams = np.concatenate([run.events["time"], run.events["time"] + run.events["duration"],
                            [instant for instant, _ in commands]])
    grids, owners = [], []
    for number, contact in enumerate(theirs):
        pieces = smooth_pieces(contact["time"], contact["time"] + contact["duration"], seams)
        grids += [grid(*piece, rate) for piece in pieces]
        owners += [number] * len(pieces)
    highest = [int(force.argmax()) for force in plate_forces(side, robot, commands, grids)]
    finer = [np.linspace(grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)], 201)
             for grid, top in zip(grids, highest, strict=True)]
    # a damper takes up its share at once, where the contact begins, of which the grid knows no instant
    peaks = np.where(scene[f"effects.{side}_contact"] == "compliant",
                     scene[f"{side}.plate.damping"] * theirs["speed"], 0.0)
    np.maximum.at(peaks, owners, [force.max() for force in plate_forces(side, robot, commands, finer)])
    # the last grid's instants are 0.01 / POINTS rad apart: at most an eighth of that, squared, is missed
    limit = (position * sum(stiffness(scene, guide, part) for guide, part in springs)
             + (0.01 / POINTS) ** 2 / 8.0 * peaks)
    assert_close(f"peak of {side}_contact", theirs["time"], ours["peak_force"], peaks, limit)


def smooth_pieces(begin, end, seams):
    """Yield the parts of a contact between instants at which a force may jump."""
    edges = np.unique(np.concatenate([[begin], seams[(seams > begin) & (seams < end)], [end]]))
    return list(zip(edges[:-1], edges[1:], strict=True))


def grid(begin, end, rate):
    """Instants within, denser towards either end."""
    near = np.geomspace(1e-9, 1e-2, 15)
    even = np.linspace(0.0, 1.0, max(64, int(POINTS * rate * (end - begin))))[1:-1]
    return begin + (end - begin) * np.sort(np.concatenate([near, even, 1.0 - near]))


def plate_forces(side, robot, commands, grids):
    """Return the plate's forces in heyoka's motion at the instants of each of `grids`."""
    times = np.unique(np.concatenate(grids))
    times = times[np.append(True, np.diff(times) > 1e-16)]  # what heyoka, who counts from a command, tells apart
    moved = motion(robot.scene, robot.integrate(times, commands))
    rigid = robot.scene[f"effects.{side}_contact"] == "restitution"
    forces = moved.forces()[f"{side}_plate_force"] if rigid else moved.push(side)
    return [forces[np.searchsorted(times, grid, side="right") - 1] for grid in grids]

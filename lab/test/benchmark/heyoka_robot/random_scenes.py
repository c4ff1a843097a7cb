"""Scenes drawn at random, for comparisons beyond the stored ones.

Left out is what no arithmetic decides: a body at rest without force under a negative normal force (so no
standing motor or slider with the rule `printed`), and a mass that returns to zero penetration at zero speed.
"""

import math
import random

SIDES = ("upper", "inclined")


def draw(seed: int) -> tuple[dict, list]:
    """Changes of the paper's parameters, and commands, of scene number `seed`."""
    pick = random.Random(seed)

    def between(low, high):
        return math.exp(pick.uniform(math.log(low), math.log(high)))

    changes = {
        "effects.normal_force": pick.choice(["printed", "unilateral", "weight"]),
        "start.state": pick.choice(["rest", "zero"]), "effects.adhesion": pick.random() < 0.5,
        "effects.friction": pick.choice(["coulomb"] * 6 + ["none"]),
        "guide.angle": pick.choice([math.pi / 2, pick.uniform(0.1, 3.0), pick.uniform(0.3, 1.6)]),
        "crank.radius": pick.choice([0.02, 0.06, 0.0599, pick.uniform(0.001, 0.06)]),
        "motor.speed": pick.choice([100.0, pick.uniform(5.0, 400.0)]),
        "mass.body": between(0.1, 5.0), "mass.upper": between(0.01, 0.5), "mass.inclined": between(0.01, 0.5),
        "ground.friction": pick.choice([0.2, between(0.01, 2.0)]),
    }
    if changes["effects.normal_force"] == "printed":
        changes["crank.radius"] = min(changes["crank.radius"], 0.0599)  # at l = L the slider stands half the turn
    for side in SIDES:
        changes |= {
            f"{side}.spring.stiffness": pick.choice([1e3, between(10.0, 1e5)]),
            f"{side}.spring.damping": pick.choice([0.0, 2.0, between(0.1, 50.0)]),
            f"{side}.plate.stiffness": pick.choice([1e7, between(1e3, 1e9)]),
            f"{side}.plate.damping": pick.choice([0.0, 100.0, between(1.0, 3e3)]),
            f"{side}.gap": pick.choice([0.0, pick.uniform(-0.01, 0.01)]),
        }
    changes |= _motor(pick, between)
    commands = _commands(pick)
    return changes | _ground(pick, between, changes) | _masses(pick, changes), commands


def _ground(pick, between, changes):
    """Static friction for some of the scenes with friction."""
    if changes["effects.friction"] == "none" or pick.random() < 0.5:
        return {}
    return {"effects.friction": "static", "ground.static_friction": changes["ground.friction"] * between(1.0, 2.0)}


def _masses(pick, changes):
    """Weight and reaction for half of the scenes; the reaction only where it has a unique solution for every N."""
    inclined, angle = changes["mass.inclined"], changes["guide.angle"]
    total = changes["mass.body"] + changes["mass.upper"] + inclined
    unlike = total - inclined * math.sin(angle) ** 2  # M - m3 sin²φ: the body's share of the inertia
    unique = changes["ground.friction"] * inclined * abs(math.sin(angle) * math.cos(angle)) < 0.9 * unlike
    return {"effects.reaction": unique and pick.random() < 0.5, "effects.mass_weight": pick.random() < 0.5}


def _motor(pick, between):
    return {"effects.motor": pick.choice(["ideal", "ramp"]), "motor.acceleration": between(100.0, 5e3),
            "gap_actuator.speed": between(0.001, 0.2)}


def _commands(pick):
    commands, time = [], 0.0
    for _ in range(pick.randint(0, 3)):
        time = round(time + pick.uniform(0.001, 0.04), 4)
        change = {"motor_speed": round(pick.uniform(5.0, 300.0), 1)}
        change |= {f"{side}_gap": round(pick.uniform(-0.01, 0.01), 5) for side in SIDES if pick.random() < 0.5}
        commands.append([str(time), change])
    return commands

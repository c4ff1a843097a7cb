"""Write the reference tables: `python test/reference/generate.py` (about two minutes; needs python-flint).

A table holds a scene's parameters, commands and samples as 30-digit decimals, its events, and how
far a second run of other order and precision lies from it. `--scene`, `--duration` and `--folder`
write part of them elsewhere, which is how a test proves that this command makes the stored files.
"""

import argparse
import json
import sys
import time
from pathlib import Path

from flint import arb, ctx

sys.path.insert(0, str(Path(__file__).parents[2] / "lab"))
from benchmark.reference_model import ReferenceModel  # noqa: E402

DIGITS = 30
TABLES = Path(__file__).with_name("tables")

PAPER = {
    "mass.body": 1.0, "mass.upper": 0.1, "mass.inclined": 0.08,
    "crank.radius": 0.02, "crank.upper_rod": 0.06, "crank.inclined_rod": 0.06,
    "guide.angle": 0.8726646259971648,  # the double nearest to 50°
    "upper.spring.stiffness": 1e3, "upper.spring.damping": 0.0,
    "upper.plate.stiffness": 1e7, "upper.plate.damping": 0.0, "upper.gap": 0.0,
    "inclined.spring.stiffness": 1e3, "inclined.spring.damping": 0.0,
    "inclined.plate.stiffness": 1e7, "inclined.plate.damping": 0.0, "inclined.gap": 0.0,
    "ground.friction": 0.2, "ground.static_friction": 0.25, "gravity": 9.81,
    "motor.speed": 100.0, "motor.acceleration": 200.0,
    "gap_actuator.speed": 0.005, "start.state": "rest",
    "effects.upper_contact": "compliant", "effects.inclined_contact": "compliant", "effects.adhesion": True,
    "effects.friction": "coulomb", "effects.normal_force": "printed", "effects.motor": "ideal",
    "effects.reaction": False, "effects.mass_weight": False,
}
DAMPED = {f"{side}.{part}.damping": damping for side in ("upper", "inclined")
          for part, damping in (("spring", 2.0), ("plate", 100.0))} | {"effects.normal_force": "unilateral"}
DEGREES_80 = 1.3962634015954636  # the double nearest to 80°

# name: (changes of the paper's values, commands, duration [s])
SCENES = {
    f"loss_free_{force}_{start}": ({"effects.normal_force": force, "start.state": start}, [], 0.2)
    for force in ("printed", "unilateral", "weight") for start in ("rest", "zero")
} | {
    "damped_adhesion": (DAMPED, [], 1.0),
    "damped_no_tension": (DAMPED | {"effects.adhesion": False}, [], 1.0),
    "gaps_80_degrees": ({"guide.angle": DEGREES_80, "upper.gap": 0.0005, "inclined.gap": -0.0002,
                         "effects.normal_force": "unilateral"}, [], 0.2),
    "crank_near_rod": ({"crank.radius": 0.0599, "effects.normal_force": "unilateral"}, [], 0.2),
    "crank_equals_rod": ({"crank.radius": 0.06, "effects.normal_force": "unilateral"}, [], 0.2),
    "frictionless": ({"effects.friction": "none"}, [], 0.2),
    "reaction": ({"effects.reaction": True, "effects.normal_force": "unilateral"}, [], 0.2),
    "reaction_printed_heavy": ({"effects.reaction": True, "mass.body": 0.2, "mass.inclined": 0.3}, [], 0.2),
    "reaction_weight_damped": (DAMPED | {"effects.reaction": True, "effects.mass_weight": True}, [], 1.0),
    "mass_weight": ({"effects.mass_weight": True, "effects.normal_force": "unilateral"}, [], 0.2),
    "static_friction": ({"effects.friction": "static", "ground.static_friction": 0.4,
                         "effects.normal_force": "unilateral"}, [], 0.2),
    "static_reaction_damped": (DAMPED | {"effects.friction": "static", "ground.static_friction": 0.3,
                                         "effects.reaction": True, "effects.mass_weight": True,
                                         "effects.adhesion": False}, [], 0.5),
    "ramp_and_gaps": (DAMPED | {"motor.speed": 0.0, "effects.motor": "ramp", "motor.acceleration": 500.0},
                      [["0", {"motor_speed": 100.0}], ["0.3", {"upper_gap": 0.0005, "inclined_gap": -0.0005}],
                       ["0.35", {"motor_speed": 60.0, "upper_gap": -0.0001}], ["0.7", {"motor_speed": 0.0}]], 1.0),
}


def decimal(number: arb) -> str:
    """Return the midpoint of a ball in decimal, with DIGITS digits."""
    return arb(number.mid()).str(DIGITS, radius=False)


def integrate(name: str, duration: float, order: int, digits: int) -> ReferenceModel:
    """Run scene `name` for `duration` [s]; its samples at every 0.01 s are left in `.rows`."""
    changes, commands, _ = SCENES[name]
    model = ReferenceModel(PAPER | changes, commands, order, digits)
    model.rows = []
    for index in range(round(duration * 100) + 1):
        model.advance_to((arb(index) / 100).mid())
        model.rows.append(model.sample())
    return model


def table(name: str, duration: float | None) -> dict:
    """The table of scene `name`."""
    changes, commands, full = SCENES[name]
    duration = full if duration is None else duration
    check = integrate(name, duration, order=60, digits=74).rows
    run = integrate(name, duration, order=48, digits=64)
    rows = run.rows
    ctx.dps = 64
    gap = max(abs(float(a[key] - b[key])) for a, b in zip(rows, check, strict=True)
              for key in ("body_position", "upper_position", "inclined_position"))
    columns = {key: [decimal(row[key]) for row in rows] for key in rows[0]}
    events = [{key: entry if key == "kind" else decimal(entry) for key, entry in event.items()} for event in run.events]
    return {"scene": name, "made_by": "python test/reference/generate.py", "parameters": PAPER | changes,
            "commands": commands, "distance_to_second_run": f"{gap:.1e}", "samples": columns, "events": events}


def main() -> None:
    """Write the tables that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=sorted(SCENES), action="append", help="only this one (may be repeated)")
    parser.add_argument("--duration", type=float, help="seconds instead of the scene's own")
    parser.add_argument("--folder", type=Path, default=TABLES, help="where to write")
    options = parser.parse_args()
    for name in options.scene or SCENES:
        began = time.perf_counter()
        made = table(name, options.duration)
        (options.folder / f"{name}.json").write_text(json.dumps(made, indent=1) + "\n")
        print(f"{name}: {len(made['events'])} events, second run within {made['distance_to_second_run']} m, "
              f"{time.perf_counter() - began:.1f} s", flush=True)


if __name__ == "__main__":
    main()

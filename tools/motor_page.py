"""The tables of docs/guide/motor.md: what a flywheel does to the crank, and the Sommerfeld effect."""

import sys
from pathlib import Path

import numpy as np

from tools.generated_text import write_between
from tools.speeds import measured_motions
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.simulation.simulator import Simulator

FLYWHEEL = "<!-- flywheel: written by `make documents` -->", "<!-- end of flywheel -->"
SOMMERFELD = "<!-- Sommerfeld: written by `make documents` -->", "<!-- end of Sommerfeld -->"
#: Inertia of crank and flywheel [kg m²]; that of `machine` among them.
INERTIAS = (3.5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 5e-3)
#: Voltages [V] that are commanded upwards and then downwards, each for `STEP` [s].
VOLTAGES, STEP = range(26, 54, 2), 2.0
SPEED, STARTS = 100.0, 16
_MEASURES = ("mean_speed", "mean_power", "supply_power", "current_share")
#: A change of the mean speed [rad/s] from one voltage to the next that is a jump.
JUMP = 50.0
# `machine` without plates, slider masses and flywheel, with a winding of 3 ohm.
_WEAK = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "mass.upper_slider": 0.0,
         "mass.inclined_slider": 0.0, "motor.control": "voltage", "motor.winding_resistance": 3.0,
         "motor.supply_voltage": 60.0, "motor.crank_inertia": 3.5e-5}


def flywheel_table() -> str:
    """A row for each motion with each flywheel, and with a motor whose speed nothing changes."""
    rows = ["| flywheel [kg m²] | motion of the body | ripple of the crank's speed, peak to peak | rms current | "
            "power from the supply | power to the masses |", "|---|---|---|---|---|---|"]
    machine = load_scene("machine").with_parameters({"motor.speed": SPEED})
    for inertia in INERTIAS:
        remark = " (`machine`)" if inertia == machine["motor.crank_inertia"] else ""
        for motion in measured_motions(machine.with_parameters({"motor.crank_inertia": inertia}), _MEASURES, STARTS):
            current = motion.values["current_share"] * machine["motor.continuous_current"]
            rows.append(f"| {inertia:g}{remark} | {motion.in_words(STARTS)} | "
                        f"{100 * np.ptp(motion.samples.crank_speed) / SPEED:.0f} % | {current:.2f} A | "
                        f"{motion.values['supply_power']:.1f} W | {motion.values['mean_power']:.1f} W |")
    for motion in measured_motions(machine.with_parameters({"effects.motor": "ramp"}), _MEASURES, STARTS):
        rows.append(f"| motor `ramp` | {motion.in_words(STARTS)} | 0 | - | - | {motion.values['mean_power']:.1f} W |")
    return "\n".join(rows)


def sommerfeld_speeds() -> tuple[list[float], list[float]]:
    """Mean speed [rad/s] in the last quarter of each step, upwards and downwards, by `VOLTAGES`."""
    device, ways = Simulator(load_scene("machine").with_parameters(_WEAK)), list[list[float]]()
    for voltages in (VOLTAGES, reversed(VOLTAGES)):
        speeds = []
        for voltage in voltages:
            begun = device.time
            device.command(motor_voltage=float(voltage))
            device.advance_to(begun + 0.75 * STEP)
            last = device.sample(np.arange(begun + 0.75 * STEP, begun + STEP, 1e-3))
            speeds.append(float(np.mean(last.crank_speed)))
            device.advance_to(begun + STEP)
        ways.append(speeds)
    return ways[0], ways[1][::-1]


def sommerfeld_table() -> str:
    """Speeds upwards and downwards, and a sentence on where they jump."""
    up, down = sommerfeld_speeds()
    rows = ["| voltage [V] | going up [rad/s] | going down [rad/s] |", "|---|---|---|"]
    rows += [f"| {voltage} | {upwards:.0f} | {downwards:.0f} |"
             for voltage, upwards, downwards in zip(VOLTAGES, up, down, strict=True)]
    words = [f"{direction} the speed jumps between {VOLTAGES[k]} and {VOLTAGES[k + 1]} V" for direction, speeds in (
        ("Going up", up), ("going down", down)) for k in range(len(up) - 1) if speeds[k + 1] - speeds[k] > JUMP]
    return "\n".join([*rows, "", f"{'; '.join(words)}."])


def main() -> int:
    """Write both tables into the page."""
    page = Path(__file__).resolve().parents[1] / "docs/guide/motor.md"
    write_between(page, *FLYWHEEL, flywheel_table)
    write_between(page, *SOMMERFELD, sommerfeld_table)
    return 0


if __name__ == "__main__":
    sys.exit(main())

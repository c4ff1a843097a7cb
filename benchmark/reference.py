"""Make the data files in `problems/`: `python -m benchmark.reference`, or some of them by name; needs python-flint.

Each problem is integrated twice by `reference_model`, with 48 powers in 64 digits and with 60 powers in 74 digits; the
file says to how many digits the two agree.
"""

import json
import math
import sys
from collections.abc import Sequence
from typing import Any

from flint import arb, ctx

from benchmark.problems import COLUMNS, FOLDER, Problem
from benchmark.reference_model import ReferenceModel, derivative, exact, value

_ROBOT: dict[str, Any] = {
    "m1": 1.0, "m2": 0.1, "m3": 0.08, "l": 0.02, "L2": 0.06, "L3": 0.06, "phi": 0.8726646259971648, "omega": 100.0,
    "g": 9.81, "mu": 0.2, "k2": 1e3, "c2": 0.0, "k4": 1e7, "c4": 0.0, "gap2": 0.0, "k3": 1e3, "c3": 0.0, "k1": 1e7,
    "c1": 0.0, "gap3": 0.0, "normal": "unilateral", "adhesion": True, "reaction": False, "weight": False,
}
_DAMPED = {"c2": 2.0, "c3": 2.0, "c4": 100.0, "c1": 100.0}
_PAIR = _ROBOT | {"m2": 0.1, "m3": 0.1, "phi": 0.0, "omega": 60.0, "mu": 0.0, "normal": "weight"}
_GRAZE = 1e-9  # m

#: name: (title, parameters, duration [s], judged columns)
PROBLEMS: dict[str, tuple[str, dict[str, Any], float, list[str]]] = {
    "1_impact": ("Impact oscillator in resonance", _ROBOT | {"m3": 0.0, "mu": 0.0, "normal": "weight"}, 0.5, ["u"]),
    "2_grazing": ("One nanometre on either side of grazing", _PAIR, 0.2, ["u", "du", "w", "dw"]),
    "3_stick_slip": ("Stick-slip oscillator", _ROBOT | {
        "m2": 0.0, "m3": 0.5, "phi": math.pi / 2, "c3": 2.0, "k1": 0.0, "normal": "weight", "reaction": True,
        "omega": 30.0}, 0.5, ["x"]),
    "4_damped": ("Vibro-impact robot, damped", _ROBOT | _DAMPED, 0.2, ["x"]),
    "5_loss_free": ("Vibro-impact robot without loss in springs and plates", _ROBOT, 0.2, ["x"]),
    "6_device": ("Vibro-impact robot that hops", _ROBOT | _DAMPED | {
        "normal": "hop", "adhesion": False, "reaction": True, "weight": True}, 0.2, ["x"]),
}
_STAND_IN = 0.25  # kg, of a mass that is absent: it hangs on nothing, and the body is lighter by it
#: Parameters that the model asks for and these problems do not use.
_UNUSED = {"motor.acceleration": 0.0, "gap_actuator.speed": 0.0}
#: Events that every program may count alike; of those of friction, a change during a loss of contact is a convention.
_KINDS = {"upper_contact", "inclined_contact", "lift_off", "landing"}
_FRICTION = {"stick", "slip_forward", "slip_backward"}
_ROWS = 21
DIGITS = 34


def integrate(parameters: dict[str, Any], duration: float, order: int, digits: int) -> tuple[list, list]:
    """Rows of `COLUMNS` at `_ROWS` instants, and the events."""
    problem = Problem("", "", parameters, {}, (), {}, {}, (), 0)
    values: dict[str, Any] = _UNUSED | problem.scene()
    for side in ("upper", "inclined"):
        if not values[f"effects.{side}_mass"]:
            values |= {f"mass.{side}": _STAND_IN, "mass.body": values["mass.body"] - _STAND_IN,
                       f"{side}.spring.stiffness": 0.0}
    model, rows = ReferenceModel(values, (), order, digits), []
    for index in range(_ROWS):
        model.advance_to(exact(arb(index) * arb(duration) / (_ROWS - 1)))
        upper, inclined = model.guides
        rows.append([upper.position, upper.velocity, inclined.position, inclined.velocity, model.body_position,
                     model.body_velocity, model.height, model.climb])
        for side, place in (("upper", 0), ("inclined", 2)):
            if not values[f"effects.{side}_mass"]:
                rows[-1][place:place + 2] = arb(0), arb(0)
    return rows, model.events


def grazing_gap() -> arb:
    """The gap at which the oscillator of `2_grazing` just reaches its plate: its farthest turning point, by bisection.

    The turning point is where u' changes sign between the two instants around the largest sample.
    """
    free = _PAIR | {"k4": 0.0, "k1": 0.0}
    problem = Problem("", "", free, {}, (), {}, {}, (), 0)
    model = ReferenceModel(_UNUSED | problem.scene())
    best, before = arb(-1), arb(0)
    for index in range(1, 801):  # a quarter of a millisecond
        now = exact(arb(index) / 4000)
        model.advance_to(before)
        series, low, high = model.guides[0].series, arb(0), exact(now - before)
        slope = derivative(series)
        if slope[0] > 0 and value(slope, high) < 0:
            for _ in range(190):
                middle = exact((low + high) / 2)
                low, high = (middle, high) if value(slope, middle) > 0 else (low, middle)
            reached = value(series, low)
            best = reached if reached > best else best
        before = now
    return exact(best - arb(_PAIR["L2"]))


def data(name: str) -> dict[str, Any]:
    """What the data file of a problem holds."""
    title, parameters, duration, judged = PROBLEMS[name]
    if name == "2_grazing":
        graze = grazing_gap()
        parameters = parameters | {"gap2": float(graze + _GRAZE), "gap3": float(graze - _GRAZE)}
    check, _ = integrate(parameters, duration, order=60, digits=74)
    rows, found = integrate(parameters, duration, order=48, digits=64)
    ctx.dps = 64
    gap = max(abs(float(a - b)) for pair in zip(rows, check, strict=True) for a, b in zip(*pair, strict=True))
    kinds = {event["kind"] for event in found} & (_KINDS | (_FRICTION if parameters["normal"] == "weight" else set()))
    events = {kind: [event["time"] for event in found if event["kind"] == kind] for kind in sorted(kinds)}
    start = {column: float(number) for column, number in zip(COLUMNS, rows[0], strict=True)}
    return {
        "title": title, "made_by": f"python -m benchmark.reference {name}", "parameters": parameters, "start": start,
        "judged": judged, "digits": 60 if gap == 0.0 else math.floor(-math.log10(gap)),
        "times": [decimal(exact(arb(index) * arb(duration) / (_ROWS - 1)), 6) for index in range(_ROWS)],
        "events": {kind: {"count": len(times), "first": decimal(min(times)), "last": decimal(max(times))}
                   for kind, times in events.items()},
        "values": {column: [decimal(row[k]) for row in rows] for k, column in enumerate(COLUMNS)},
    }


def decimal(number: arb, digits: int = DIGITS) -> str:
    """The midpoint with that many digits."""
    return arb(number.mid()).str(digits, radius=False)


def main(words: Sequence[str]) -> int:
    """Write the data files asked for."""
    for name in words or PROBLEMS:
        made = data(name)
        (FOLDER / f"{name}.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
        print(f"{name}: agrees with the second run to {made['digits']} digits; "
              + ", ".join(f"{event['count']} {kind}" for kind, event in made["events"].items()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

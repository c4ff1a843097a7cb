"""Make the data files in `problems/`: `python -m benchmark.reference`, or some of them by name; needs python-flint.

Each problem is integrated twice by `reference_model`, with 64 powers in 84 digits and with 76 powers in 94 digits; the
file says to how many decimals the two agree. `7_bounce` has a closed form (`bounced`), which the second run confirms.
"""

import json
import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from flint import arb, ctx
from mpmath import mp, mpf

from benchmark.problems import COLUMNS, FOLDER, STAND_IN, ReferenceProblem
from benchmark.reference_model import ReferenceModel, derivative, exact, value

_ROBOT: dict[str, Any] = {
    "m1": 1.0, "m2": 0.1, "m3": 0.08, "l": 0.02, "L2": 0.06, "L3": 0.06, "phi": 0.8726646259971648, "omega": 100.0,
    "g": 9.81, "mu": 0.2, "k2": 1e3, "c2": 0.0, "k4": 1e7, "c4": 0.0, "gap2": 0.0, "k3": 1e3, "c3": 0.0, "k1": 1e7,
    "c1": 0.0, "gap3": 0.0, "normal": "unilateral", "adhesion": True, "reaction": False, "weight": False,
    "restitution": 0.0,
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
    "7_bounce": ("Ball that bounces to rest", _ROBOT | {
        "m2": 0.0, "m3": 0.0, "mu": 0.0, "normal": "hop", "restitution": 0.6}, 0.8, ["y", "dy"]),
}
#: m, height from which the ball of `7_bounce` falls, so that its bounces accumulate 1e-10 s after the sample at 0.56 s.
_HEIGHT = 0.09613800003433502
#: Parameters that the model requires and these problems do not use.
_UNUSED = {"motor.acceleration": 0.0, "gap_actuator.speed": 0.0}
#: Kinds of events that all programs can count in the same way; friction is left out, because a change of its state
#: during a loss of contact is a convention.
_KINDS = {"upper_contact", "inclined_contact", "lift_off", "landing"}
_FRICTION = {"stick", "slip_forward", "slip_backward"}
_ROWS = 21
#: Decimal digits of the stored values; digits of the arithmetic and number of powers, of the first run and of the
#: second.
DIGITS, FIRST, SECOND = 60, {"order": 64, "digits": 84}, {"order": 76, "digits": 94}


def _unsolved(parameters: dict[str, Any], height: float = 0.0) -> ReferenceProblem:
    """Return a problem without reference values, whose body starts at a height [m]."""
    return ReferenceProblem("", "", parameters, {"y": height}, np.zeros(0), {}, {}, (), 0)


def integrate(parameters: dict[str, Any], duration: float, order: int, digits: int) -> tuple[list, list]:
    """Return rows of `COLUMNS` at `_ROWS` instants, and the events."""
    problem = _unsolved(parameters, _HEIGHT if parameters["restitution"] else 0.0)
    values: dict[str, Any] = _UNUSED | problem.scene_parameters()
    for side in ("upper", "inclined"):
        if not values[f"effects.{side}_mass"]:
            values |= {f"mass.{side}": STAND_IN, "mass.body": values["mass.body"] - STAND_IN,
                       f"{side}.spring.stiffness": 0.0}
    model, rows = ReferenceModel(values, (), order, digits), []
    for index in range(_ROWS):
        model.advance_to(exact(arb(index) * arb(duration) / (_ROWS - 1)))
        upper, inclined = model.guides
        rows.append([upper.position, upper.velocity, inclined.position, inclined.velocity, model.body_position,
                     model.body_velocity, model.height, model.climb])
        for mass, place in (("m2", 0), ("m3", 2)):
            if not parameters[mass]:
                rows[-1][place:place + 2] = arb(0), arb(0)
    return rows, model.events


def grazing_gap() -> arb:
    """Return the gap at which the oscillator of `2_grazing` just reaches its plate: its farthest turning point, found
    by bisection.

    The turning point is where u' changes sign between the two instants around the largest sample.
    """
    free = _PAIR | {"k4": 0.0, "k1": 0.0}
    problem = _unsolved(free)
    model = ReferenceModel(_UNUSED | problem.scene_parameters())
    best, previous = arb(-1), arb(0)
    for index in range(1, 801):  # a quarter of a millisecond
        now = exact(arb(index) / 4000)
        model.advance_to(previous)
        series, low, high = model.guides[0].series, arb(0), exact(now - previous)
        slope = derivative(series)
        if slope[0] > 0 and value(slope, high) < 0:
            for _ in range(190):
                middle = exact((low + high) / 2)
                low, high = (middle, high) if value(slope, middle) > 0 else (low, middle)
            reached = value(series, low)
            best = reached if reached > best else best
        previous = now
    return exact(best - arb(_PAIR["L2"]))


def bounced(parameters: dict[str, Any], duration: float) -> tuple[list, list]:
    """Return the rows, and the first and the last landing, of a ball that falls from `_HEIGHT`, in closed form by
    mpmath.

    The first landing is at T = √(2h/g). Flight k = 1, 2, … begins at the speed eᵏ g T and lasts 2 eᵏ T. The flights
    from k on together last 2 eᵏ T / (1 - e), and all end at T (1 + e)/(1 - e), from where on the ball rests.
    """
    mp.dps, rows = FIRST["digits"], []
    e, g, height = (mpf(number) for number in (parameters["restitution"], parameters["g"], _HEIGHT))
    first = mp.sqrt(2 * height / g)
    last = first * (1 + e) / (1 - e)
    for index in range(_ROWS):
        t = mpf(index) * mpf(duration) / (_ROWS - 1)
        y, dy = height - g * t * t / 2, -g * t
        if t >= last:
            y, dy = mpf(0), mpf(0)
        elif t >= first:
            power = e ** mp.floor(mp.log((last - t) * (1 - e) / (2 * first)) / mp.log(e))
            within = t - (last - 2 * power * first / (1 - e))
            y, dy = (power * g * first - g * within / 2) * within, g * (power * first - within)
        rows.append([arb(0)] * 6 + [arb(mp.nstr(number, mp.dps)) for number in (y, dy)])
    return rows, [{"kind": "landing", "time": arb(mp.nstr(time, mp.dps))} for time in (first, last)]


def data(name: str) -> dict[str, Any]:
    """Return the contents of a problem's data file."""
    title, parameters, duration, judged = PROBLEMS[name]
    if name == "2_grazing":
        graze = grazing_gap()
        parameters = parameters | {"gap2": float(graze + _GRAZE), "gap3": float(graze - _GRAZE)}
    check, _ = integrate(parameters, duration, **SECOND)
    closed = parameters["restitution"] > 0.0
    rows, events = (bounced(parameters, duration) if closed else integrate(parameters, duration, **FIRST))
    ctx.dps = FIRST["digits"]
    gap = max(abs(float(a - b)) for pair in zip(rows, check, strict=True) for a, b in zip(*pair, strict=True))
    kinds = {event["kind"] for event in events} & (_KINDS | (_FRICTION if parameters["normal"] == "weight" else set()))
    times = {kind: [event["time"] for event in events if event["kind"] == kind] for kind in sorted(kinds)}
    start = {column: float(number) for column, number in zip(COLUMNS, rows[0], strict=True)}
    return {
        "title": title, "made_by": f"python -m benchmark.reference {name}", "parameters": parameters, "start": start,
        "judged": judged, "digits": FIRST["digits"] if gap == 0.0 else math.floor(-math.log10(gap)),
        "times": [decimal(exact(arb(index) * arb(duration) / (_ROWS - 1)), 6) for index in range(_ROWS)],
        "events": {kind: {"count": "infinitely many" if closed else len(all_times), "first": decimal(min(all_times)),
                          "last": decimal(max(all_times))} for kind, all_times in times.items()},
        "values": {column: [decimal(row[k]) for row in rows] for k, column in enumerate(COLUMNS)},
    }


def decimal(number: arb, digits: int = DIGITS) -> str:
    """Return the midpoint of a ball in decimal, with the given number of digits."""
    return arb(number.mid()).str(digits, radius=False)


def main(words: Sequence[str]) -> int:
    """Write the data files that the command line names."""
    for name in words or PROBLEMS:
        made = data(name)
        (FOLDER / f"{name}.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
        print(f"{name}: agrees with the second run to {made['digits']} digits; "
              + ", ".join(f"{event['count']} {kind}" for kind, event in made["events"].items()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""What a search has found, in Markdown and as pictures: every number comes from a `Result`."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vibro_ros.accuracy.figures import GRID, new_figure
from vibro_ros.accuracy.starts import Average
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.study.optimise.plan import FRONT, OBJECTIVES, Plan
from vibro_ros.study.optimise.result import Result
from vibro_ros.study.optimise.search import Candidates, FrontRobot
from vibro_ros.study.optimise.verification import (
    ACCOUNTS,
    OPTIMUM,
    PAPER,
    PERTURBATION,
    Behaviour,
    Neighbourhood,
    Verified,
)

POWER = {"net": "the work of the motor less what the springs return to it, over time",
         "delivered": "the work that the motor delivers, over time; what the springs return to it is lost"}
"""What P is, by the reading."""
_DIRECTIONS = {"either": "in either direction", "forward": "forwards only", "backward": "backwards only"}
_ENDS = {"low": "lower", "high": "upper", "": ""}


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _number(value: float) -> str:
    """`value` to three digits; a dash for what is no number."""
    if not math.isfinite(value):
        return "-"
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if 1e3 <= abs(float(text)) < 1e6 else text


def _with_spread(found: Average | None, factor: float = 1.0) -> str:
    """Mean ± half the 95 % interval, times `factor`; of starts that repeat one motion there is no interval."""
    if found is None or not math.isfinite(found.mean):
        return "-"
    if found.is_one_motion and found.mean:
        return f"{_number(factor * found.mean)} (same motion)"
    return f"{_number(factor * found.mean)} ± {factor * found.spread:.2g}"


def _speeds(row: Verified) -> str:
    """Signed mean speed [mm/s]; of starts with several motions, each with its share of the starts."""
    if len(row.motions) < 2:
        return _with_spread(row.speed, 1e3)
    return "; ".join(
        f"{_with_spread(Average(mean, spread, 0), 1e3) if spread is not None else _number(1e3 * mean)} "
        f"({starts} of {sum(one[2] for one in row.motions)} starts)" for mean, spread, starts in row.motions)


def document(result: Result) -> str:
    """The summary of a search."""
    parts = [f"# {title(result.plan)}", *_question_and_verdict(result), "## Parameters", *_parameters(result),
             "## Verification", *_verification(result), "## Motion and energy", *_motion_and_energy(result.behaviour),
             "## Neighbourhood", *_neighbourhood(result.around)]
    if result.front:
        parts += ["## Speed against cost of transport", *_front(result.front, result.verified[:3])]
    return "\n\n".join(parts) + "\n"


def title(plan: Plan) -> str:
    """What is sought."""
    what = "the front of speed and cost of transport" if plan.objective == FRONT else OBJECTIVES[plan.objective].does
    return f"Optimum: {what}, scene {plan.space.scene.name}"


def _question_and_verdict(result: Result) -> list[str]:
    """How was searched; and the optimum against the paper's under the same reading, a sentence a quantity."""
    plan, trials = result.plan, result.plan.effort.trials
    floor = f" A robot slower than {_number(plan.least_speed * 1e3)} mm/s does not count." if plan.least_speed else ""
    if plan.most_air < 1.0:
        floor += f" A robot that is in the air for more than {100 * plan.most_air:g} % of the time does not count."
    how = "CMA-ES, one weight of speed and cost after the other," if plan.objective == FRONT else (
        "CMA-ES with BIPOP restarts")
    asked = (f"P is mean mechanical power: {POWER[plan.reading.power]}. {how} tried {result.robots} robots, each "
            f"from the same {trials.starts} drawn starts over {trials.duration:g} s after {trials.settling:g} s. The "
            f"score is the lower quartile of these starts. Speed counts {_DIRECTIONS[plan.reading.direction]}, and all "
            f"starts must agree.{floor}")
    best, paper = (next(row for row in result.verified if row.robot == robot) for robot in (OPTIMUM, PAPER))
    speeds = (f"The optimum goes at {_speeds(best)} mm/s, the paper's optimum (φ = 80°, m3 = 0.02 kg, "
              f"l = 0.06 m) at {_speeds(paper)} mm/s, forward positive: {_beats(paper.margin, 1e3, 'mm/s')}.")
    if not math.isfinite(best.cost):
        return [asked, speeds]
    return [asked, f"{speeds} Its V/P is {_with_spread(best.ratio)} m/J against {_with_spread(paper.ratio)} m/J: "
            f"{_beats(paper.ratio_margin, 1.0, 'm/J')}."]


def _beats(margin: Average | None, factor: float, unit: str) -> str:
    if margin is None or not abs(margin.mean) > margin.spread:
        return f"no difference beyond noise ({_with_spread(margin, factor)} {unit})"
    more = "more" if margin.mean > 0.0 else "LESS"
    return f"{_number(factor * abs(margin.mean))} ± {factor * margin.spread:.2g} {unit} {more}"


def on_bounds(result: Result) -> str:
    """Which parameters of the optimum lie on a bound, and what the score would gain beyond it."""
    ends = {variable.name: end for variable, end in zip(result.plan.space.variables, result.on_bound, strict=True)
            if end}
    if not ends:
        return "No parameter lies on a bound."
    alone = {one.name: one for one in result.around.sensitivities}
    gain, where = max((alone[name].lower if end == "low" else alone[name].upper, name) for name, end in ends.items())
    listed = ", ".join(f"`{name}` ({_ENDS[end]})" for name, end in ends.items())
    beyond = f"`{where}` gains most, {100 * (gain - 1.0):.1f} % of the score" if gain > 1.0 else "none gains"
    return (f"{len(ends)} of {len(result.on_bound)} parameters lie on a bound, and are the bounds' choice as much as "
            f"the robot's: {listed}. {100 * PERTURBATION:g} % beyond, {beyond}.")


def _parameters(result: Result) -> list[str]:
    """What `on_bounds` says, and a table of all parameters."""
    rows = []
    for variable, end in zip(result.plan.space.variables, result.on_bound, strict=True):
        parameter = BY_NAME[variable.name]
        rows.append([f"`{variable.name}`", variable.symbol, _number(result.optimum[variable.name]),
                     _number(parameter.default), parameter.unit,
                     f"{_number(variable.low)} to {_number(variable.high)}{', log' if variable.logarithmic else ''}",
                     _ENDS[end], variable.reason])
    heads = ["parameter", "symbol", "optimum", "paper", "unit", "bounds", "on bound", "why these bounds"]
    return [on_bounds(result), _table(heads, rows)]


def _verification(result: Result) -> list[str]:
    trials = result.plan.effort.verifying
    said = (f"{trials.starts} drawn starts that the search has not seen, {trials.duration:g} s each after "
            f"{trials.settling:g} s; mean ± half the 95 % interval. A margin is the optimum less the robot of the row, "
            "start by start, each counted positive in its own direction. Mean N over the weight must be 1 on a real "
            "ground; a robot with more is held down by the rule of its row, and would not do this.")
    return [said, _table(
        ["reading", "robot", "speed, forward positive [mm/s]", "same way from all starts", "mean N over weight",
         "time with N <= 0 [%]", "in the air [%]", "P net [W]", "P delivered [W]", "V/P [m/J]",
         "cost of transport", "margin of speed [mm/s]", "margin of V/P [m/J]"],
        ([row.reading, row.robot, _speeds(row), "yes" if row.agree else "no", _number(row.load),
          f"{100 * row.unloaded:.0f}", f"{100 * row.air:.0f}", _with_spread(row.power),
          _with_spread(row.delivered), _with_spread(row.ratio) if math.isfinite(row.cost) else "-", _number(row.cost),
          _with_spread(row.margin, 1e3), _with_spread(row.ratio_margin) if math.isfinite(row.cost) else "-"]
         for row in result.verified))]


def _motion_and_energy(found: Behaviour) -> list[str]:
    seen = found.measures
    sides = " and ".join(f"the {side} mass {_number(seen[f'{side}_impacts'])} times a turn with up to "
                         f"{_number(seen[f'{side}_peak_force'])} N" for side in ("upper", "inclined"))
    said = (f"From one start {sides} strike their plates; the body is in the air for {100 * seen['air_share']:.0f} % "
            f"of the time and stands still for {100 * seen['stick_share']:.0f} %.")
    return [said, _table(["energy from one start", "mean power [W]"], (
        [words, _number(found.powers[name])] for name, words in ACCOUNTS.items() if name in found.powers))]


def _neighbourhood(around: Neighbourhood) -> list[str]:
    worst = min((min(one.lower, one.upper), one.name) for one in around.sensitivities)
    said = (f"Of {around.robots} robots within {100 * PERTURBATION:g} % in every parameter at once, half keep at least "
            f"{100 * around.median:.0f} % of the optimum's score and 95 % keep {100 * around.poorest:.0f} %. Alone, "
            f"`{worst[1]}` costs most: {100 * worst[0]:.0f} % are left.")
    shift = f"{100 * PERTURBATION:g} %"
    return [said, _table(
        ["parameter", f"score at -{shift}", f"score at +{shift}", "first-order index", "total index"],
        ([f"`{one.name}`", _number(one.lower), _number(one.upper), f"{one.first:.2f} ± {one.first_spread:.2f}",
          f"{one.total:.2f} ± {one.total_spread:.2f}"]
         for one in sorted(around.sensitivities, key=lambda one: -one.total)))]


def _front(front: Sequence[FrontRobot], rows: Sequence[Verified]) -> list[str]:
    """From where to where a front reaches, and what of it is faster and cheaper than the paper's robots."""
    text = (f"The front reaches from {_number(1e3 * front[0].speed)} mm/s at a cost of transport of "
            f"{_number(front[0].cost)} to {_number(1e3 * front[-1].speed)} mm/s at {_number(front[-1].cost)}.")
    for row in rows:
        better = [one for one in front if one.speed > abs(row.speed.mean) + row.speed.spread and one.cost < row.cost]
        if row.robot != OPTIMUM and better:
            text += (f" Against the {row.robot}, {_number(1e3 * abs(row.speed.mean))} mm/s at {_number(row.cost)}, it "
                     f"has {_number(1e3 * better[0].speed)} mm/s at {_number(better[0].cost)}.")
    heads = ["speed [mm/s]", "cost of transport", "P [W]", "V/P [m/J]", "motor speed [rad/s]", "crank [mm]",
             "guide angle [°]", "inclined mass [kg]"]
    return [text, _table(
        heads, ([_number(1e3 * one.speed), _number(one.cost), _number(one.power), _number(one.speed / one.power),
                   _number(one.robot["motor.speed"]), _number(1e3 * one.robot["crank.radius"]),
                   _number(math.degrees(one.robot["guide.angle"])), _number(one.robot["mass.inclined"])]
                  for one in front))]


# Speed [m/s] below which a robot stands still for all that can be seen.
_SLOWEST = 1e-4
_COST = "cost of transport P / (M g V) [-]"
# Okabe and Ito's colours, which the colour-blind can tell apart
_ALL, _BEST, _OTHER, _THIRD = "#56b4e9", "#000000", "#d55e00", "#009e73"


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    figure = new_figure(width, height)
    axes = figure.subplots()
    axes.grid(color=GRID)
    axes.set_axisbelow(True)
    return figure, axes


def draw_convergence(plan: Plan, candidates: Candidates, title: str) -> Figure:
    """Score of every candidate in turn, and the best so far."""
    figure, axes = _figure(8.0, 4.5)
    scores = np.array([plan.score(values) for values in candidates.values])
    scores, turns = np.where(scores > 0.0, scores, np.nan), np.arange(1, len(scores) + 1)
    axes.plot(turns, scores, ".", ms=2.0, color=_ALL, label="a robot", rasterized=True)
    axes.plot(turns, np.fmax.accumulate(scores), color=_BEST, label="best so far")
    axes.set(xlabel="robots tried", ylabel=f"score [{plan.unit}]", title=title)
    axes.legend(frameon=False)
    return figure


def draw_front(result: Result, candidates: Candidates, title: str) -> Figure:
    """Cost of transport over speed: all candidates, the front from fresh starts, and the robots that were verified."""
    figure, axes = _figure(8.0, 5.5)
    plan = result.plan
    every = np.array([plan.speed_and_cost(point, values)
                      for point, values in zip(candidates.points, candidates.values, strict=True)])
    every = every[np.isfinite(every[:, 1]) & (every[:, 0] > _SLOWEST)]
    axes.plot(1e3 * every[:, 0], every[:, 1], ".", ms=2.0, color=_ALL, label="a robot of the search", rasterized=True)
    front = result.front
    axes.plot([1e3 * one.speed for one in front], [one.cost for one in front], "-o", ms=3.0, color=_BEST,
              label="front, from fresh starts")
    for row, mark in zip(result.verified, "*sD", strict=False):
        if row.cost > 0.0:
            axes.errorbar(1e3 * abs(row.speed.mean), row.cost, xerr=1e3 * row.speed.spread, fmt=mark, ms=8.0,
                          color=_OTHER if row.robot == OPTIMUM else _THIRD, label=row.robot)
    axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel=_COST, title=title)
    axes.legend(frameon=False)
    return figure


def draw_sensitivity(around: Neighbourhood, title: str) -> Figure:
    """Sobol's indices of every parameter, the largest on top."""
    rows = sorted(around.sensitivities, key=lambda one: one.total)
    figure, axes = _figure(8.0, 1.5 + 0.3 * len(rows))
    places = np.arange(len(rows))
    axes.barh(places + 0.2, [one.total for one in rows], 0.4, xerr=[one.total_spread for one in rows], color=_OTHER,
              label="total")
    axes.barh(places - 0.2, [one.first for one in rows], 0.4, xerr=[one.first_spread for one in rows], color=_ALL,
              label="first order")
    axes.set_yticks(places, [one.name for one in rows])
    axes.set(xlabel=f"Sobol index within {100 * PERTURBATION:g} % of the optimum, 95 % intervals", title=title)
    axes.legend(frameon=False, loc="lower right")
    return figure

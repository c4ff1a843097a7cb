"""Curves of special points over two parameters: folds, period doublings and grazings.

Where a branch over one parameter has a special point, the special points of its neighbours over a second parameter form
a curve. The curve is followed by pseudo-arclength (H. B. Keller 1977) in the state and both parameters; its equations
are those of `bifurcation`.

A curve is smooth as long as the order of the orbit's events stays. Where it changes, the curve is sought on the other
side, as a branch is; it may end there.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from vibro_ros.orbits.bifurcation import FOLLOWED, Bifurcation, away, found_near
from vibro_ros.orbits.branch import MOST_POINTS, Branch, Closing, Special, range_left, sequence_of
from vibro_ros.orbits.continuation import FIRST_STEP, GRAZING, NEAREST_EVENT, STRAIGHT
from vibro_ros.orbits.family import LONGEST_STEP, Family, LostError
from vibro_ros.orbits.passage import change_in_words, same_order
from vibro_ros.orbits.turn_map import TURN
from vibro_ros.simulation.motion import SimulationError

EDGE = "change of events"
_FEW = 6  # iterations of Newton's method at most before a step that is longer
_SHORTEST, _SHORT = 1e-8, 1e-5  # steps along a curve: the least, and that at which the other side of events is tried
_ARCS = (1e-5, 1e-4, 1e-3)  # to the first point on the other side
_ASIDE = 3.0  # arcs that a curve may turn aside within an arc at a change of events
_AHEAD = 1e-6  # along the curve: where its direction is looked for when the cut changes
_NUDGES = (1e-6, -1e-6, 1e-5, -1e-5, 1e-4, -1e-4, 1e-3, -1e-3)  # of a parameter, to the side of a grazing without it
_FOUND = 1e-5  # units of the machine, shares and m/s: how near special points of a curve and of a branch are


def follow_bifurcation(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]],
                       upwards: bool = True, points: int = 400) -> Branch:
    """The curve of folds, period doublings or grazings through a special point of a branch.

    Pseudo-arclength continuation in the state and two parameters; see `vibro_ros.orbits.curve`.

    Parameters
    ----------
    branch : Branch
        As `follow_orbit` gives it.
    special : Special
        One of its special points; no corner, no Neimark-Sacker point, and no grazing of the body on the ground.
    ranges : mapping of str to (float, float)
        The branch's parameter and another number among the scene's parameters, with their ranges, in their units.
    upwards : bool
        Whether to begin towards larger values of the other parameter.
    points : int
        Most orbits on the way, from 2 to 100 000.

    Returns
    -------
    Branch
        The orbits, over two parameters, and the changes of the order of events between them.

    Raises
    ------
    ValueError
        For a special point that has no curve, parameters that are not these two, a range that is none or does not hold
        the special point, or a number of points out of range.

    Examples
    --------
    >>> orbit = vibro_ros.find_orbit(vibro_ros.load_scene("damped"))
    >>> branch = vibro_ros.follow_orbit(orbit, "motor.speed", 99.0, 109.0, points=30)
    >>> fold = branch.special_points[0]
    >>> curve = vibro_ros.follow_bifurcation(branch, fold, {"motor.speed": (99.0, 109.0), "upper.gap": (0.0, 1e-4)})
    >>> curve.kind, f"{curve.values[0, 0]:.6f}", curve.end
    ('fold', '107.959911', 'upper.gap leaves its range at 0.0001 m')
    """
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 2 <= points <= MOST_POINTS:
        raise ValueError(f"points: {points!r} is out of range; give a whole number from 2 to {MOST_POINTS}")
    return whole_curve(branch, special, ranges, upwards, points)


def _family(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]]) -> Family:
    """The equations, the branch's parameter first (ValueError as `follow_bifurcation` has it)."""
    if not has_curve(special):
        change = f" ({special.change})" if special.change else ""
        raise ValueError(f"special: a {special.kind}{change} has no curve; give a fold, a period doubling, or a "
                         "grazing of a plate")
    if len(ranges) != 2:
        raise ValueError(f"ranges: {len(ranges)} parameters; give two, such as "
                         "{'motor.speed': (95.0, 115.0), 'upper.gap': (0.0, 0.002)}")
    if branch.name not in ranges:
        raise ValueError(f"ranges: has no {branch.name}, the branch's parameter; give its range and that of another")
    family = Family(branch.scene, {name: ranges[name] for name in sorted(ranges, key=branch.name.__ne__)}, branch.turns,
                    special.phase)
    for name, value in zip(family.names, (special.value, branch.scene[family.names[1]]), strict=True):
        if not ranges[name][0] <= value <= ranges[name][1]:
            raise ValueError(f"{name}: the special point's {value:g} is not from {ranges[name][0]:g} to "
                             f"{ranges[name][1]:g}; give a range that holds it")
    return family


def _start(family: Family, branch: Branch, special: Special, upwards: bool) -> Bifurcation:
    """The special point as the first of a curve (LostError)."""
    guess = np.append(special.state, family.scaled(special.value, branch.scene[family.names[1]]))
    across, nudge = np.zeros((2, len(guess)))
    across[-1], nudge[-2] = 1.0 if upwards else -1.0, 1.0
    reason = ""
    for size in _NUDGES if special.kind == GRAZING else (0.0,):
        try:
            start, _ = found_near(family, special.kind, guess + size * nudge, across, None)
        except LostError as error:
            reason = reason or str(error)
            continue
        if np.abs(start.unknowns - guess).max() < _FOUND:
            return start
        reason = f"another {special.kind} was found in its place"
    raise LostError(f"the special point was not found again: {reason}")


def has_curve(special: Special) -> bool:
    """Whether special points like this one are followed over two parameters."""
    return special.kind in FOLLOWED and (special.kind != GRAZING or "_contact" in special.change)


def whole_curve(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]], upwards: bool, points: int
                ) -> Branch:
    """As `follow_bifurcation`, its arguments checked."""
    family, found = _family(branch, special, ranges), list[Bifurcation]()
    met, end = list[Special](), f"{points} orbits, the most that were asked for"
    try:
        start = _start(family, branch, special, upwards)
        closing = Closing(start)
        for before, after in follow(start):
            left = range_left(after.family, after.unknowns)
            if left:
                end, after = left[0], _at_bound(before, after, left[1])
            elif found and (reason := closing.reason(before, after)):
                end = reason
                break
            if not same_order(before.passage.order, after.passage.order):
                change = change_in_words(before.passage.order, after.passage.order)
                met.append(Special(EDGE, before.mean_speed, before.multipliers, change, before.family.phase,
                                   before.state, len(found), before.values))
            found.append(after)
            if left or len(found) >= points:
                break
    except (LostError, SimulationError) as error:
        end = str(error)
    return sequence_of(family, found, end, {}, tuple(met), special.kind)


def _at_bound(before: Bifurcation, after: Bifurcation, normal: np.ndarray) -> Bifurcation:
    """The point between two neighbours at which the curve leaves a range."""
    bound = max(0.0, np.sign(normal[-2:].sum()))
    part = (bound - abs(normal) @ before.unknowns) / (abs(normal) @ (after.unknowns - before.unknowns))
    guess = before.near + part * (after.near - before.near)
    guess += (bound - abs(normal) @ guess) * abs(normal)
    return found_near(before.family, before.kind, guess, normal, before.frame, away(before, normal))[0]


def passes(curve: Branch, branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a curve through another special point of this kind passes through a special point of a branch, too."""
    if not len(curve) or (curve.kind, curve.turns) != (special.kind, branch.turns):
        return False
    across, second = np.eye(len(special.state) + 2)[-1], branch.scene[curve.names[1]]
    beside = curve.values[:, 1] - second
    for k in np.flatnonzero(beside[1:] * beside[:-1] <= 0.0):
        near = k if abs(beside[k]) <= abs(beside[k + 1]) else k + 1
        family = Family(branch.scene, {name: ranges[name] for name in curve.names}, curve.turns,
                        float(curve.phases[near]))
        guess = np.append(curve.states[near], family.scaled(curve.values[near, 0], second))
        try:
            found, _ = found_near(family, special.kind, guess, across, None)
        except LostError:
            continue
        apart = abs(found.unknowns[-2] - family.scaled(special.value, second)[0])
        if apart < _FOUND and abs(found.mean_speed - special.mean_speed) < _FOUND:
            return True
    return False


def follow(start: Bifurcation) -> Iterator[tuple[Bifurcation, Bifurcation]]:
    """Neighbours on a curve from a point on, along its tangent, until it leaves the range of a parameter.

    Yields
    ------
    Bifurcation, Bifurcation
        A point and the next, with one cut; first the start and itself.

    Raises
    ------
    LostError
        Where the curve cannot be followed.
    """
    point, step = _well_cut(start), FIRST_STEP
    yield point, point
    while np.all((point.near[-2:] >= 0.0) & (point.near[-2:] <= 1.0)):
        after, step = _next(point, step)
        yield point, after
        point = _well_cut(after)


def _next(point: Bifurcation, step: float) -> tuple[Bifurcation, float]:
    """The next point, also beyond a change of events; and the step after it."""
    family, reason, apart = point.family, "", away(point, point.tangent)
    while step >= _SHORTEST:
        guess, crosses = point.near + step * point.tangent, False
        try:
            after, iterations = found_near(family, point.kind, guess, point.tangent, point.frame, apart)
            crosses = not same_order(after.passage.order, point.passage.order)
            if not crosses and after.tangent @ point.tangent >= STRAIGHT:
                return after, min(LONGEST_STEP, step * (1.5 if iterations <= _FEW else 1.0))
            reason = f"the curve bends too sharply near {family.where(after.near)}"
        except LostError as error:
            reason = str(error)
            try:
                crosses = not same_order(family.order(guess), point.passage.order)
            except (SimulationError, ValueError):
                crosses = False
        if crosses and step < _SHORT:
            return _beyond(point), FIRST_STEP
        step *= 0.5
    raise LostError(reason)


def _beyond(point: Bifurcation) -> Bifurcation:
    """The first point of the curve on the other side of a change of events."""
    change = ""
    for arc in _ARCS:
        guess = point.near + arc * point.tangent
        try:
            order = point.family.order(guess)
            change = change or change_in_words(point.passage.order, order)
            after, _ = found_near(point.family, point.kind, guess, point.tangent, None)
        except (LostError, SimulationError, ValueError):
            continue
        same = same_order(after.passage.order, point.passage.order)
        if not same and np.linalg.norm(after.near - guess) < _ASIDE * arc:
            return after
    raise LostError(f"the curve ends at {point.family.where(point.unknowns)}, where its events change ({change}); no "
                    f"{point.kind} was found beyond")


def _well_cut(point: Bifurcation) -> Bifurcation:
    """The same orbit, cut far from all events, and from the instant of a grazing."""
    family, seen = point.family, point.passage

    def from_grazing(phase: float) -> float:
        return abs((point.frame.angle - phase + 0.5 * TURN) % TURN - 0.5 * TURN) / TURN if point.frame.side else 1.0

    if min(seen.clear, from_grazing(family.phase)) >= NEAREST_EVENT:
        return point
    phase = (seen.best + 0.5 if point.frame.side and not seen.order else seen.best) % TURN
    if from_grazing(phase) < NEAREST_EVENT:
        phase = (phase + 2.0 * NEAREST_EVENT * TURN) % TURN
    family, (here, ahead) = family.recut(phase, [point.near, point.near + _AHEAD * point.tangent])
    along = (ahead - here) / np.linalg.norm(ahead - here)
    try:
        return found_near(family, point.kind, here, along, None)[0]
    except LostError:
        return point

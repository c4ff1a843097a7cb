"""The motion document: every quantity at every instant of a motion, small enough to be mailed.

A motion is cut into pieces, at every event and wherever else it is needed. In a piece each quantity is a polynomial

    value(t) = sum over k of c_k T_k(s),    s = (t - begin) / (end - begin) * 2 - 1  in [-1, 1],

with the Chebyshev polynomials T_k(s) = cos(k arccos(s)). A document is a header, which is ready for JSON, and a
payload: three arrays one behind the other, little-endian, P pieces and Q quantities:

``borders``, float64
    Begin and end [s] of each piece, 2 P numbers, ascending. The last instant of a piece is the first of the next one,
    except where nothing is known in between: there one piece ends earlier than the next begins. Where two pieces meet,
    the later one holds.
``coefficients``, float64
    For each piece and each of its known quantities c_0 to c_degree (SI), in the order of the degrees.
``degrees``, uint8
    P x Q numbers, piece by piece: the degree of each quantity's polynomial, or `UNKNOWN`.

The header: ``pieces``, P; ``coefficients``, their number; ``quantities``, Q names of fields of `Samples`; ``begin`` and
``end`` [s] of the motion; ``exact``, whether all pieces are simulated exactly, and ``why``, a sentence if they are not;
``exact_spans``, pairs of begin and end [s] of the exact parts; ``impacts``, a list of ``time`` and ``end`` [s],
``side``, ``peak_force`` [N] (null for a rigid plate, where an impact is an instant); ``resets``, the instants [s] of
the first samples after resets; for a recording of the robot's own recorder also ``pushes`` of the body, a list of
``begin`` and ``end`` [s], ``force_x`` and ``force_z`` [N].

`fitted_motion` makes the pieces from exact intervals and interpolated samples. A piece is sampled at the nodes of
Chebyshev's first kind, which lie inside it, so that a jump at an event affects neither side. Where the last
coefficients of a quantity are too large to be neglected, the piece is halved; that also finds jumps without an event.
"""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.messages.robot_messages import PLATES
from vibro_ros.model.scene import Scene
from vibro_ros.sensors.device import new_device
from vibro_ros.simulation.runs import commanded_samples
from vibro_ros.simulation.simulator import Simulator, ToleranceWarning

UNKNOWN = 255  # degree that marks a quantity as unknown in a piece
Document = tuple[dict[str, Any], bytes]  # header and payload
Span = tuple[float, float]  # begin and end [s]
Progress = Callable[[float], object]  # callback with the share of the work that is done, from 0 to 1

MOST_A_SECOND, MOST_OF_STEPS = 20_000, 2000
"""Most pieces that halving adds in a second, for the method exact and for the others, whose every step may be a jump
too small to see."""
NODES = 20  # coefficients of a polynomial: the number from 12 to 24 that gives the smallest documents
LONGEST = 0.02  # longest piece [s], about a third of a turn of the crank at 100 rad/s
#: Distance [s] within which borders are merged: at the speed of an impact, 4 m/s, nothing moves by 1e-10 m in it.
MERGE_DISTANCE = 2e-11
SHORTEST = 1e-9  # length [s] up to which a piece is not halved
_TAIL_LENGTH = 3  # number of last coefficients, all of which must be negligible
#: Halving has helped if the last coefficients of one half shrink to less than this fraction; those of a smooth quantity
#: nearly vanish.
_SHRINK_FACTOR = 0.2
#: Number of halvings in a row without help after which a piece is not halved again; it has too many jumps.
_MOST_FAILED_HALVINGS = 4

#: Borders [s], shape (p, 2), and Chebyshev coefficients (SI), shape (p, quantities, n), of interpolated pieces.
Interpolated = tuple[np.ndarray, np.ndarray]
#: Function that samples every quantity at ascending instants [s], shape (n,): array of shape (n, quantities).
Sampler = Callable[[np.ndarray], np.ndarray]

#: Precision of a position [m] and of an angle [rad]: the error of a polynomial of 20 coefficients is at most 5e-10 m.
_POSITION_PRECISION = 5e-11
#: Precision of other quantities, relative to their largest value: the error is at most 2e-7 of it.
_RELATIVE_PRECISION = 2e-8
#: Least precision of a position relative to its largest value: rounding is no smaller.
_LEAST_RELATIVE_PRECISION = 1e-13


def is_position(name: str) -> bool:
    """Return whether a field of `Samples` is a position [m], or the crank's angle [rad]."""
    return name.endswith(("position", "height", "angle"))


def precisions(names: Sequence[str], largest: np.ndarray) -> np.ndarray:
    """Return the precision of each quantity's coefficients (SI) from its largest magnitude; shape (quantities,)."""
    are_positions = np.array([is_position(name) for name in names])
    of_positions = np.maximum(_POSITION_PRECISION, _LEAST_RELATIVE_PRECISION * largest)
    precision = np.where(are_positions, of_positions, _RELATIVE_PRECISION * largest)
    return np.where(precision > 0.0, precision, 1.0)  # where a quantity is always 0


class MotionWriter:
    """Collects the pieces of a motion of some quantities; `size` is the payload's size so far [bytes].

    `precision` is that of each quantity's coefficients (SI). Coefficients are rounded to multiples of the power of two
    below it, and zeros at a polynomial's end are left out, to make the document small.
    """

    def __init__(self, quantities: Sequence[str], precision: Sequence[float] | np.ndarray):
        self.quantities, self.size = tuple(quantities), 0
        self.precision = np.array(precision, dtype=float)
        self._step = 2.0 ** np.floor(np.log2(self.precision))[:, None]
        self._borders: list[np.ndarray] = [np.empty((0, 2))]
        self._coefficients: list[np.ndarray] = [np.empty(0)]
        self._degrees: list[np.ndarray] = [np.empty((0, len(self.quantities)), np.uint8)]

    def add(self, borders: np.ndarray, coefficients: np.ndarray) -> None:
        """Append pieces after the last one.

        `borders` [s] are ascending, shape (p, 2). `coefficients` are those of the Chebyshev polynomials (SI), shape (p,
        quantities, n), not finite where a quantity is unknown.
        """
        rounded = np.rint(coefficients / self._step) * self._step
        known, orders = np.isfinite(rounded).all(axis=2), np.arange(rounded.shape[2])
        degrees = np.max(np.where(rounded != 0.0, orders, 0), axis=2)
        chosen = rounded[(orders <= degrees[:, :, None]) & known[:, :, None]]
        self._borders.append(borders)
        self._coefficients.append(chosen)
        self._degrees.append(np.where(known, degrees, UNKNOWN).astype(np.uint8))
        self.size += borders.nbytes + chosen.nbytes + known.size

    def document(self, facts: Mapping[str, Any]) -> Document:
        """Return header and payload; `facts` are further fields of the header: ``exact``, ``why``, ``impacts``, ...

        ``begin`` and ``end`` are those of the pieces, unless `facts` has them.
        """
        borders, coefficients, degrees = (
            np.concatenate(parts) for parts in (self._borders, self._coefficients, self._degrees))
        begin, end = (float(borders[0, 0]), float(borders[-1, 1])) if len(borders) else (0.0, 0.0)
        header = {"begin": begin, "end": end, "pieces": len(borders), "coefficients": len(coefficients),
                  "quantities": list(self.quantities), **facts}
        return header, borders.astype("<f8").tobytes() + coefficients.astype("<f8").tobytes() + degrees.tobytes()


class Impact(NamedTuple):
    """A contact: first and last instant [s], side, peak force [N]."""

    time: float
    end: float
    side: str
    peak_force: float


def impacts_of(events: np.ndarray, offset: float) -> list[Impact]:
    """Return the contacts among events of dtype `EVENT_DTYPE`; `offset` [s] is added to their times."""
    events = events[np.isin(events["kind"], list(PLATES))]
    times = events["time"] + offset
    return [Impact(time, end, kind.partition("_")[0], force) for time, end, kind, force in zip(
        times.tolist(), (times + events["duration"]).tolist(), events["kind"].tolist(), events["peak_force"].tolist(),
        strict=True)]


def impacts_as_json(impacts: Sequence[Impact]) -> list[dict[str, Any]]:
    """Return impacts in the form of a header, sorted by time."""
    return [{**impact._asdict(), "peak_force": impact.peak_force if math.isfinite(impact.peak_force) else None}
            for impact in sorted(impacts)]


class ExactInterval(NamedTuple):
    """Exact motion of a device from one sample to a later one, in its own time [s]; robot time is this plus `offset`.

    `start` is a checkpoint at `begin`, before the commands there. A command is an instant of the device's own time [s],
    at least `begin` and less than `end`, with arguments of `Simulator.command`.
    """

    scene: Scene
    start: np.ndarray
    begin: float
    end: float
    offset: float
    commands: tuple[tuple[float, dict[str, float]], ...] = ()

    @property
    def span(self) -> Span:
        """Begin and end in robot time [s]."""
        return self.begin + self.offset, self.end + self.offset

    def values(self, device: Simulator, times: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Return quantities at ascending `times` [s] of the device's own, shape (n, names); overwrites `device`."""
        device.restore(self.start)
        samples = commanded_samples(device, times, self.commands)
        device.take_events()
        return np.column_stack([getattr(samples, name) for name in names])


def without_tolerance_warning() -> warnings.catch_warnings:
    """Return a context without the ToleranceWarning, which the robot of the scene has given already."""
    return warnings.catch_warnings(action="ignore", category=ToleranceWarning)


class FittedMotion(NamedTuple):
    """Result of `fitted_motion`: the pieces, the intervals that they reproduce exactly, and the `end` [s].

    From `end` on pieces were left out for lack of room; it is infinite if none were.
    """

    writer: MotionWriter
    exact: list[ExactInterval]
    end: float


def fitted_motion(names: Sequence[str], intervals: Sequence[ExactInterval], instants: Sequence[np.ndarray],
                  rest: Sequence[Interpolated], limit: float = math.inf,
                  progress: Progress = lambda share: None) -> FittedMotion:
    """Make the pieces of the quantities `names` in time order, as many as fit into `limit` bytes.

    `intervals` are the exact parts of the motion, by time, and `instants` [s] the events in them; `rest` are the
    interpolated parts.
    """
    events = np.sort(np.concatenate([np.empty(0), *instants]))
    device: Simulator | None = None

    def sampler(interval: ExactInterval) -> Sampler:
        nonlocal device
        if device is None or device.scene != interval.scene:
            with without_tolerance_warning():
                device = new_device(interval.scene)
        return lambda times: interval.values(device, times, names)

    rest = [pieces for pieces in rest if len(pieces[0])]
    bounds = [np.nan_to_num(np.abs(pieces[1]).sum(axis=2), posinf=np.inf).max(axis=0) for pieces in rest]
    for interval in intervals:  # the largest magnitude of each quantity, by samples within the pieces
        instants_within = _instants(_borders(interval, events), _NODE_PLACES[[0, NODES // 3, NODES // 2, -1]])
        samples = sampler(interval)(instants_within.ravel())
        bounds.append(np.abs(samples).max(axis=0, initial=0.0))
    writer = MotionWriter(names, precisions(names, np.max([np.zeros(len(names)), *bounds], axis=0)))
    parts: list[tuple[float, ExactInterval | Interpolated]] = [
        *((interval.span[0], interval) for interval in intervals), *((float(part[0][0, 0]), part) for part in rest)]
    exact, positions = list[ExactInterval](), [q for q, name in enumerate(names) if is_position(name)]
    for number, (begin, part) in enumerate(sorted(parts, key=lambda part: part[0])):
        progress(number / len(parts))
        if writer.size > limit:
            return FittedMotion(writer, exact, begin)
        if isinstance(part, ExactInterval):
            borders = _borders(part, events)
            a_second = MOST_A_SECOND if part.scene["solver.method"] == "exact" else MOST_OF_STEPS
            most = len(borders) + int(a_second * (part.end - part.begin))
            borders, coefficients, resolved = fit_pieces(sampler(part), borders, 0.5 * writer.precision, most)
            if resolved[positions].all():
                exact.append(part)
            part = borders + part.offset, coefficients
        writer.add(*part)
    return FittedMotion(writer, exact, math.inf)


def _borders(interval: ExactInterval, events: np.ndarray) -> np.ndarray:
    """Return the borders of an interval's pieces [s], shape (p, 2): cut at events, commands and controller samples."""
    inside = events[slice(*np.searchsorted(events, interval.span))] - interval.offset
    return piece_borders(interval.begin, interval.end, np.concatenate([
        inside, [time for time, _ in interval.commands],
        controller_instants(interval.scene, interval.begin, interval.end)]))


def controller_instants(scene: Scene, begin: float, end: float) -> np.ndarray:
    """Return the instants [s] of the device's own time at which the controller of a dc motor takes a sample.

    Its output jumps there without an event. Empty for a controller that takes more samples than a page can show.
    """
    rate = scene["motor.control_rate"]
    if not scene.has_rotor or scene["motor.control"] == "voltage" or rate > MOST_A_SECOND:
        return np.empty(0)
    return np.arange(math.floor(begin * rate), math.ceil(end * rate) + 1) / rate


def piece_borders(begin: float, end: float, instants: np.ndarray) -> np.ndarray:
    """Cut the time from `begin` to `end` [s] at `instants` into pieces of at most `LONGEST`; borders, shape (p, 2).

    Instants closer than `MERGE_DISTANCE` to the previous border or to the end are left out.
    """
    borders = [begin]
    for instant in np.sort(instants[(instants > begin) & (instants < end - MERGE_DISTANCE)]).tolist():
        if instant - borders[-1] > MERGE_DISTANCE:
            borders.append(instant)
    borders.append(end)
    parts = np.maximum(1, np.ceil(np.diff(borders) / LONGEST)).astype(int)
    edges = np.concatenate([*(np.linspace(left, right, count, endpoint=False)
                              for left, right, count in zip(borders[:-1], borders[1:], parts, strict=True)), [end]])
    return np.column_stack([edges[:-1], edges[1:]])


def fit_pieces(sample: Sampler, borders: np.ndarray, allowed: np.ndarray,
           most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit polynomials of every quantity in pieces, which are halved until the last coefficients are negligible.

    `borders` [s] are ascending, shape (p, 2), from `piece_borders`. `sample` samples the motion anywhere within the
    borders, and may be called repeatedly. `allowed` are the largest coefficients that may be neglected (SI); once there
    would be more than `most` pieces, none is halved any more.

    Return the borders of all pieces, ascending [s], shape (n, 2); the coefficients of the Chebyshev polynomials (SI),
    shape (n, quantities, NODES); and whether the last coefficients of each quantity are negligible in every piece.
    """
    done: list[tuple[np.ndarray, np.ndarray]] = []
    total, resolved = len(borders), np.full(len(allowed), True)
    worst_before_halving: np.ndarray = np.empty(0)
    failed_halvings: np.ndarray = np.zeros(len(borders), dtype=int)
    while len(borders):
        values = sample(_instants(borders, _NODE_PLACES).ravel())
        coefficients = np.einsum("kn,pnq->pqk", _TRANSFORM, values.reshape(len(borders), NODES, -1), optimize=True)
        # Instants are rounded, the more the later they are; a change of a quantity in that time is only noise.
        rounding = np.spacing(borders[:, 1]) / (borders[:, 1] - borders[:, 0])
        noise = 8.0 * rounding[:, None] * np.abs(coefficients[:, :, 1:]).max(axis=2)
        tails = np.abs(coefficients[:, :, -_TAIL_LENGTH:]).max(axis=2) / np.maximum(allowed, noise)  # neglected up to 1
        worst = tails.max(axis=1, initial=0.0)
        if len(worst_before_halving):  # a half shrinks unless the tails are rounding, or the steps of a method
            helped = worst.reshape(-1, 2).min(axis=1) <= np.maximum(1.0, _SHRINK_FACTOR * worst_before_halving)
            failed_halvings = np.where(np.repeat(helped, 2), 0, failed_halvings + 1)
        is_last = (borders[:, 1] - borders[:, 0] <= SHORTEST) | (failed_halvings >= _MOST_FAILED_HALVINGS)
        halved = (worst > 1.0) & ~is_last
        total += int(np.count_nonzero(halved))
        if total > most:
            is_last, halved = is_last | halved, np.full(len(halved), False)
        resolved &= (tails[is_last & (borders[:, 1] - borders[:, 0] > SHORTEST)] <= 1.0).all(axis=0)
        done.append((borders[~halved], coefficients[~halved]))
        (begin, end), middle = borders[halved].T, borders[halved].mean(axis=1)
        borders = np.column_stack([begin, middle, middle, end]).reshape(-1, 2)
        worst_before_halving, failed_halvings = worst[halved], np.repeat(failed_halvings[halved], 2)
    all_borders, polynomials = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(all_borders[:, 0], kind="stable")
    return all_borders[order], polynomials[order], resolved


def polynomials_through(borders: np.ndarray, values: Callable[[np.ndarray], np.ndarray], count: int) -> np.ndarray:
    """Return the coefficients of the polynomials through values at `count` nodes in each piece, shape (p, Q, count).

    `values` returns the values, shape (p, count, Q), at instants [s] of shape (p, count).
    """
    places, transform = _nodes(count)
    return np.einsum("kn,pnq->pqk", transform, values(_instants(borders, places)))


def _nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes in [-1, 1], ascending, and the matrix from the values there to the Chebyshev coefficients."""
    angles = (np.arange(count)[::-1] + 0.5) * np.pi / count
    transform = 2.0 / count * np.cos(np.arange(count)[:, None] * angles)
    transform[0] *= 0.5
    return np.cos(angles), transform


_NODE_PLACES, _TRANSFORM = _nodes(NODES)


def _instants(borders: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the instants [s] at the positions `places` in [-1, 1] of each piece, shape (p, places)."""
    middle, half = borders.mean(axis=1), 0.5 * (borders[:, 1] - borders[:, 0])
    inside = middle[:, None] + half[:, None] * places
    return np.clip(inside, borders[:, :1], borders[:, 1:])  # rounding must not lead out of a piece

"""Pieces of a motion in which polynomials hold every quantity: exact stretches and interpolated samples put together.

A piece is sampled at the nodes of Chebyshev's first kind, which lie inside it, so that what jumps at an event counts on
neither side. Where the last coefficients of a quantity are still larger than may be neglected, the piece is halved:
that also finds what jumps without having been announced.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.view.motion import MotionWriter, is_place, precisions
from vibro_ros.view.stretch import Progress, Stretch, quiet_device

MOST_A_SECOND, MOST_OF_STEPS = 20_000, 2000
"""Pieces of a second, by the method exact and by another one, whose every step may be a border that nobody sees."""
#: Coefficients of a polynomial: of twelve to twenty-four, those that give the smallest documents.
NODES = 20
#: Longest piece [s], about a third of a turn of the crank at 100 rad/s.
LONGEST = 0.02
#: Borders closer together [s] are one: with the speeds of a blow, 4 m/s, nothing moves by 1e-10 m in between.
TOGETHER = 2e-11
#: A piece so short [s] is not halved.
SHORTEST = 1e-9
#: The last coefficients, of which none may count.
_TAIL = 3
#: Halving has helped if the last coefficients of one half shrink to less than this part; those of a smooth quantity
#: nearly vanish.
_HELPED = 0.2
#: Times in a row that halving has not helped, after which it will not: more jumps in a piece than are unannounced.
_HOPELESS = 4

#: Borders [s], shape (p, 2), and Chebyshev coefficients (SI), shape (p, quantities, n), of interpolated pieces.
Interpolated = tuple[np.ndarray, np.ndarray]
#: Samples every quantity at ascending instants [s], shape (n,), as an array of shape (n, quantities).
Sampler = Callable[[np.ndarray], np.ndarray]


class Assembly:
    """A motion document put together: exact pieces and interpolated ones in the order of time.

    `stretches` are what is exact, by time, and `instants` the events in them [s]; `rest` is what is not. `exact` are
    those stretches whose pieces follow the simulator's positions everywhere; `end` is the instant [s] from which on
    pieces were left out, infinite if none were.
    """

    def __init__(self, names: Sequence[str], stretches: Sequence[Stretch], instants: Sequence[np.ndarray],
                 rest: Sequence[Interpolated]):
        self._names, self._instants = names, np.sort(np.concatenate([np.empty(0), *instants]))
        self._device: Simulator | None = None
        self._places = [q for q, name in enumerate(names) if is_place(name)]
        rest = [one for one in rest if len(one[0])]
        bounds = [np.nan_to_num(np.abs(one[1]).sum(axis=2), posinf=np.inf).max(axis=0) for one in rest]
        largest = np.max([np.zeros(len(names)), *map(self._largest, stretches), *bounds], axis=0)
        self._parts: list[tuple[float, Stretch | Interpolated]] = [
            *((one.span[0], one) for one in stretches), *((float(one[0][0, 0]), one) for one in rest)]
        self._parts.sort(key=lambda part: part[0])
        self.writer, self.end = MotionWriter(names, precisions(names, largest)), np.inf
        self.exact: list[Stretch] = []

    def write(self, limit: float = np.inf, progress: Progress = lambda share: None) -> None:
        """Write all pieces, or those that fit into `limit` bytes; `progress` is told the share that is done."""
        for number, (begin, part) in enumerate(self._parts):
            progress(number / len(self._parts))
            if self.writer.size > limit:
                self.end = begin
                return
            if isinstance(part, Stretch):
                borders = self._borders(part)
                a_second = MOST_A_SECOND if part.scene["solver.method"] == "exact" else MOST_OF_STEPS
                most = len(borders) + int(a_second * (part.end - part.begin))
                allowed = 0.5 * self.writer.precision
                borders, coefficients, resolved = fitted(self._sampler(part), borders, allowed, most)
                if resolved[self._places].all():
                    self.exact.append(part)
                part = borders + part.offset, coefficients
            self.writer.add(*part)

    def _borders(self, stretch: Stretch) -> np.ndarray:
        events = self._instants[slice(*np.searchsorted(self._instants, stretch.span))] - stretch.offset
        return cut(stretch.begin, stretch.end, np.concatenate([
            events, [time for time, _ in stretch.commands], controlled(stretch.scene, stretch.begin, stretch.end)]))

    def _largest(self, stretch: Stretch) -> np.ndarray:
        """Largest magnitude of each quantity in a stretch, by samples within the pieces, shape (quantities,)."""
        places = _PLACES[[0, NODES // 3, NODES // 2, -1]]
        samples = self._sampler(stretch)(_instants(self._borders(stretch), places).ravel())
        return np.abs(samples).max(axis=0, initial=0.0)

    def _sampler(self, stretch: Stretch) -> Sampler:
        if self._device is None or self._device.scene != stretch.scene:
            self._device = quiet_device(stretch.scene)
        device = self._device
        return lambda times: stretch.values(device, times, self._names)


def controlled(scene: Scene, begin: float, end: float) -> np.ndarray:
    """Instants [s] by the device's own time at which a dc motor's controller takes a sample: what it holds jumps there,
    without an event. None of a controller that takes more samples than a page can show."""
    rate = scene["motor.control_rate"]
    if not scene.has_rotor or scene["motor.control"] == "voltage" or rate > MOST_A_SECOND:
        return np.empty(0)
    return np.arange(math.floor(begin * rate), math.ceil(end * rate) + 1) / rate


def cut(begin: float, end: float, instants: np.ndarray) -> np.ndarray:
    """Borders of pieces, shape (p, 2): `begin`, `end` [s], the `instants` between them, and none longer than `LONGEST`.

    Instants that are closer than `TOGETHER` to the border before them or to the end are left out.
    """
    borders = [begin]
    for instant in np.sort(instants[(instants > begin) & (instants < end - TOGETHER)]).tolist():
        if instant - borders[-1] > TOGETHER:
            borders.append(instant)
    borders.append(end)
    parts = np.maximum(1, np.ceil(np.diff(borders) / LONGEST)).astype(int)
    edges = np.concatenate([*(np.linspace(one, other, count, endpoint=False)
                              for one, other, count in zip(borders[:-1], borders[1:], parts, strict=True)), [end]])
    return np.column_stack([edges[:-1], edges[1:]])


def fitted(sample: Sampler, borders: np.ndarray, allowed: np.ndarray,
           most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Polynomials of every quantity in the pieces with these `borders` [s], ascending, shape (p, 2), from `cut`.

    `sample` samples the motion, as often as it is asked, anywhere within the borders. `allowed` are the largest
    coefficients that may be neglected (SI); from `most` pieces on none is halved any more.

    Returns
    -------
    borders : ndarray, shape (n, 2)
        Of all pieces, ascending [s].
    coefficients : ndarray, shape (n, quantities, NODES)
        Of the Chebyshev polynomials (SI).
    resolved : ndarray of bool, shape (quantities,)
        Whether the polynomials of a quantity neglect nothing in any piece.
    """
    done: list[tuple[np.ndarray, np.ndarray]] = []
    total, resolved = len(borders), np.full(len(allowed), True)
    before: np.ndarray = np.empty(0)
    in_vain: np.ndarray = np.zeros(len(borders), dtype=int)
    while len(borders):
        values = sample(_instants(borders, _PLACES).ravel())
        coefficients = np.einsum("kn,pnq->pqk", _TRANSFORM, values.reshape(len(borders), NODES, -1), optimize=True)
        # Instants are rounded, the more the later they are; a quantity's change in that time is no sign of anything.
        rounding = np.spacing(borders[:, 1]) / (borders[:, 1] - borders[:, 0])
        noise = 8.0 * rounding[:, None] * np.abs(coefficients[:, :, 1:]).max(axis=2)
        tails = np.abs(coefficients[:, :, -_TAIL:]).max(axis=2) / np.maximum(allowed, noise)  # at most 1: neglected
        worst = tails.max(axis=1, initial=0.0)
        if len(before):  # a half shrinks unless the tails are rounding, or the steps of a method
            helped = worst.reshape(-1, 2).min(axis=1) <= np.maximum(1.0, _HELPED * before)
            in_vain = np.where(np.repeat(helped, 2), 0, in_vain + 1)
        is_last = (borders[:, 1] - borders[:, 0] <= SHORTEST) | (in_vain >= _HOPELESS)
        halved = (worst > 1.0) & ~is_last
        total += int(np.count_nonzero(halved))
        if total > most:
            is_last, halved = is_last | halved, np.full(len(halved), False)
        resolved &= (tails[is_last & (borders[:, 1] - borders[:, 0] > SHORTEST)] <= 1.0).all(axis=0)
        done.append((borders[~halved], coefficients[~halved]))
        (begin, end), middle = borders[halved].T, borders[halved].mean(axis=1)
        borders = np.column_stack([begin, middle, middle, end]).reshape(-1, 2)
        before, in_vain = worst[halved], np.repeat(in_vain[halved], 2)
    found, polynomials = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(found[:, 0], kind="stable")
    return found[order], polynomials[order], resolved


def polynomials_through(borders: np.ndarray, values: Callable[[np.ndarray], np.ndarray], count: int) -> np.ndarray:
    """Coefficients of the polynomials of degree `count` - 1 through values at as many nodes, shape (p, Q, count).

    `values` gives those at instants [s] of shape (p, count), of shape (p, count, Q).
    """
    places, transform = _nodes(count)
    return np.einsum("kn,pnq->pqk", transform, values(_instants(borders, places)))


def _nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The nodes in [-1, 1], ascending; and the matrix that makes Chebyshev coefficients of the values there."""
    angles = (np.arange(count)[::-1] + 0.5) * np.pi / count
    transform = 2.0 / count * np.cos(np.arange(count)[:, None] * angles)
    transform[0] *= 0.5
    return np.cos(angles), transform


_PLACES, _TRANSFORM = _nodes(NODES)


def _instants(borders: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Instants [s] of some places in [-1, 1] in each piece, shape (p, places)."""
    middle, half = borders.mean(axis=1), 0.5 * (borders[:, 1] - borders[:, 0])
    inside = middle[:, None] + half[:, None] * places
    return np.clip(inside, borders[:, :1], borders[:, 1:])  # rounding leads out of no piece

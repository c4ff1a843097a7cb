"""Linear forms as text in the paper's symbols.

u = zeta_2 and w = xi_3 (masses), x and y (body), s_B and s_C (sliders), E and H (plates); a prime is a rate.
"""

from collections.abc import Iterable, Iterator

from vibro_ros.model.forms import Form, Forms

MASS = {"upper": "u", "inclined": "w"}
SLIDER = {"upper": "s_B", "inclined": "s_C"}
PLATE = {"upper": "E", "inclined": "H"}

#: A coefficient smaller than this part of the terms that cancel in it is rounding.
_ROUNDING = 1e-12


class Symbols:
    """Writes the forms of one scene.

    Parameters
    ----------
    forms : Forms
        The forms of the scene.
    """

    def __init__(self, forms: Forms):
        self._channels = forms.channels
        self._coordinates = [MASS[side] for side in forms.guides] + ["x"] * forms.body_moves + (
            ["y"] * forms.body_hops)
        self._guides, self._plates = forms.guides, forms.plates

    @property
    def coordinates(self) -> list[str]:
        """Symbols of the coordinates, in their order."""
        return self._coordinates

    def text(self, form: Form) -> str:
        """The form with its coefficients, such as ``-1000 (u - s_B) - 1e+07 (u - E)``; ``0`` when it is empty."""
        return total(self._terms(form))

    def _terms(self, form: Form) -> Iterator[tuple[float, str]]:
        """Coefficients and symbols: first differences to sliders and plates, then other channels, the constant last."""
        left = dict(enumerate(map(float, form)))
        largest = {channel: abs(factor) for channel, factor in left.items()}
        for own, other, text in self._differences():
            factor = left.pop(other)
            if factor:
                left[own] += factor
                largest[own] = max(largest[own], abs(factor))
                yield -factor, text
        names = self._names()
        for channel, factor in left.items():
            if abs(factor) > _ROUNDING * largest[channel]:
                yield factor, names[channel]

    def _differences(self) -> Iterator[tuple[int, int, str]]:
        """Channel of a mass, channel of its slider or plate, and the text of their difference; also of the rates."""
        at = self._channels
        for i, side in enumerate(self._guides):
            mass, slider = MASS[side], SLIDER[side]
            yield at.position(i), at.signal(i), f"({mass} - {slider})"
            yield at.velocity(i), at.signal_rate(i), f"({mass}' - {slider}')"
        for k, side in enumerate(self._plates):
            i, mass, plate = self._guides.index(side), MASS[side], PLATE[side]
            yield at.position(i), at.ramp(k), f"({mass} - {plate})"
            yield at.velocity(i), at.ramp_rate(k), f"({mass}' - {plate}')"

    def _names(self) -> dict[int, str]:
        """Symbols of the channels that may stand alone in a text."""
        at = self._channels
        names = {at.one: ""}
        for i, symbol in enumerate(self._coordinates):
            names |= {at.position(i): symbol, at.velocity(i): f"{symbol}'"}
            if i < at.dynamic:
                names[at.acceleration(i)] = f"{symbol}''"
        return names


def ratio(form: Form, other: Form) -> float | None:
    """The factor c with form = c `other`, exactly or to rounding; None if there is no such factor."""
    size = float(other @ other)
    factor = float(form @ other) / size if size else 0.0
    return factor if abs(form - factor * other).max() <= _ROUNDING * abs(form).max() else None


def product(factor: float, symbol: str) -> str:
    """Text of factor times symbol, without a factor of 1."""
    return total([(factor, symbol)])


def total(terms: Iterable[tuple[float, str]]) -> str:
    """Text of a sum of factors times symbols; ``0`` when it is empty."""
    text = ""
    for factor, symbol in terms:
        sign = "-" if factor < 0.0 else "+"
        number = "" if abs(factor) == 1.0 and symbol else f"{abs(factor):.6g}"
        term = f"{number} {symbol}".strip()
        text += f" {sign} {term}" if text else f"{sign.replace('+', '')}{term}"
    return text or "0"

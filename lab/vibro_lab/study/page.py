"""Text of pages in Markdown: tables, and numbers with three digits."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a line for each row; a bar within a cell is a slash, because it would end the cell."""
    first, *others = (f"| {' | '.join(str(cell).replace('|', '/') for cell in cells)} |" for cells in (heads, *rows))
    return "\n".join([first, "|---" * len(heads) + "|", *others])


def number(value: float, factor: float = 1.0) -> str:
    """Format `factor` times a value with three digits; a dash if it is not finite."""
    text = f"{factor * value:.3g}"
    return "-" if not math.isfinite(value) else f"{float(text):.0f}" if 1e3 <= abs(float(text)) < 1e6 else text


def mean_in_words(statistic: Mapping[str, float], factor: float = 1.0) -> str:
    """Format a mean ± half its interval; an interval below 1e-5 belongs to one periodic motion, and is not shown."""
    shown = math.isfinite(statistic["mean"]) and statistic["spread"] > 1e-5 * abs(statistic["mean"])
    return number(statistic["mean"], factor) + (f" ± {factor * statistic['spread']:.2g}" if shown else "")


def finite(value: Any) -> Any:
    """Replace numbers that are not finite by None, because JSON does not have them."""
    if isinstance(value, dict):
        return {name: finite(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

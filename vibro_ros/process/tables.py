"""Tables of pandas, which is imported only for them, because it takes half a second and nothing else needs it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas

AXES = "xyzw"  # ends of the names of an array's columns: `position.x` is the first column of `position`


def as_table(arrays: Mapping[str, np.ndarray]) -> "pandas.DataFrame":
    """Return arrays as a table with the index `time` [s].

    An array of shape (n, 3) becomes three columns such as `position.x`, `position.y` and `position.z`, one of shape
    (n, 4) a fourth one, `.w`. ModuleNotFoundError without pandas; the message says how to install it.
    """
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"to_pandas needs pandas ({error}): pip install pandas", name="pandas") from None
    columns: dict[str, np.ndarray] = {}
    for name, values in arrays.items():
        columns |= {name: values} if values.ndim == 1 else {
            f"{name}.{axis}": column for axis, column in zip(AXES, values.T, strict=False)}
    return pandas.DataFrame(columns, index=pandas.Index(columns.pop("time"), name="time"))

"""What a runner is: a module in `runners/` with `SETTINGS`, `version()` and `prepare(problem, setting)`.

`prepare` compiles what is not to be counted and returns a function without arguments; each call of it is one run from
the start. A runner raises `UnableError` for what its program cannot do. Everything else that may happen, a crash or an
endless loop too, is caught by the process that calls it (`benchmark.run`).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

#: As its documentation recommends, and as an expert sets it.
PLAIN, TUNED = "as documented", "tuned"


#: Outcome of a run whose body is deeper below a ground that it may leave than it truly rises above it.
FALLS = "falls through the ground"
#: Error of a run that diverges, in spans of the reference.
DIVERGED = 10.0


class Setting(NamedTuple):
    """One way to use a program: `kind` is `PLAIN` or `TUNED`, `value` a step [s] or a tolerance."""

    kind: str
    label: str
    value: float


class Answer(NamedTuple):
    """Rows of `problems.COLUMNS` at the sampled instants, and how often each kind of event was met (None: not told)."""

    states: Sequence[Sequence[float]]
    events: Mapping[str, int] | None = None


class UnableError(Exception):
    """What a program cannot do, in one line."""

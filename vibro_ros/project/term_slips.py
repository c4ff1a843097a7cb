"""Terms of the field that are spelt otherwise than everywhere else. codespell sees to the other words."""

import re
from collections.abc import Iterator
from pathlib import Path

#: How not to spell a term, as a pattern, and how to.
TERMS = {
    r"Runge[– ]Kutta": "Runge-Kutta",
    r"stick[-/ ]slip": "stick–slip",
    r"work[- ]precision": "work–precision",
    r"non-linear": "nonlinear",
    r"nonsmooth": "non-smooth",
    r"liftoff|lift-of\b": "lift-off",
    r"closed-form": "closed form",
    r"time-?steps?\b(?!-)": "time step",
    r"event[- ]capturing": "time stepping",
    r"frictional coefficient|coefficient of (kinetic |static )?friction": "friction coefficient",
    r"coefficient of restitution": "restitution",
    r"Painleve\b": "Painlevé",
    r"Helouvry": "Hélouvry",
    r"behavior": "behaviour",
    r"artifact": "artefact",
    r"(?<!\.)analyz": "analys",  # other libraries name functions so
    r"neighbor": "neighbour",
}
_PLACES = ("*.md", "docs/**/*.md", "vibro_ros/**/*.py", "config/**/*.yaml", "Makefile", "setup.py")
WRONG = re.compile("|".join(f"(?P<t{number}>{pattern})" for number, pattern in enumerate(TERMS)))


def term_slips(root: Path) -> Iterator[str]:
    """Yield a sentence for each term that is spelt otherwise, in the texts and sources of the repository at `root`."""
    spellings = tuple(TERMS.values())
    for file in sorted(file for pattern in _PLACES for file in root.glob(pattern)):
        if file.name == Path(__file__).name:
            continue
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
            for found in WRONG.finditer(line):
                right = spellings[int((found.lastgroup or "")[1:])]
                if found[0] != right:
                    yield f"{file.relative_to(root)}:{number}: {found[0]}: write {right}"

"""Findings of a study of a publication: mapping, check, claims with verdicts, and missing parts; their Markdown."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

from matplotlib.figure import Figure

HOLDS, FAILS, NOISE, OUTSIDE = "holds", "does not hold", "within noise", "not contained"
MISSIGNED = "published sign wrong"
#: Explanation of each verdict, printed in the document.
VERDICTS = {
    HOLDS: "the model's number and the published one agree within the stated margin, or what is said to occur occurs",
    FAILS: "they differ by more than the margin, or what is said to occur does not",
    MISSIGNED: "closed form and simulation agree with each other, and with the statement but for a reversed sign",
    NOISE: "the model's interval allows both answers",
    OUTSIDE: "the published statement needs something that the model does not have, or a number that could not be read",
}


@dataclass(frozen=True)
class Mapped:
    """One line of a mapping: a symbol of the publication, its meaning, and its counterpart in this model."""

    theirs: str
    meaning: str
    ours: str


@dataclass(frozen=True)
class Check:
    """An independent integration of the published equations beside the model's own."""

    what: str  # description of the comparison, with the unit
    error: float  # largest difference, in this unit
    bound: float  # its upper bound

    @property
    def passed(self) -> bool:
        """Whether the difference is below the bound, so that the model contains the publication's."""
        return self.error <= self.bound


@dataclass(frozen=True)
class Claim:
    """A published statement, the model's result, and the verdict by a stated rule."""

    statement: str
    ours: str
    verdict: str
    rule: str


@dataclass(frozen=True)
class Finding:
    """Findings about one publication, or about several on the same machine."""

    name: str
    title: str
    sources: tuple[str, ...]
    contained: str
    mapping: tuple[Mapped, ...]
    checks: tuple[Check, ...]
    claims: tuple[Claim, ...]
    missing: str


@dataclass(frozen=True)
class Studied:
    """A finding and the function that draws its picture."""

    finding: Finding
    draw: Callable[[], Figure]


def from_data(data: dict) -> Finding:
    """Rebuild a finding from its `dataclasses.asdict`."""
    parts = {"mapping": Mapped, "checks": Check, "claims": Claim}
    known = {name: tuple(kind(**part) for part in data[name]) for name, kind in parts.items()}
    return Finding(**{**data, "sources": tuple(data["sources"]), **known})


def section(finding: Finding, picture: str) -> str:
    """Return a finding as a section in Markdown, with its `picture`."""
    parts = [f"## {finding.title}", "\n".join(f"- {source}" for source in finding.sources), finding.contained,
             _table(["theirs", "meaning", "ours"], [(row.theirs, row.meaning, row.ours) for row in finding.mapping]),
             _table(["checked independently", "largest difference", "must be below", "passed"],
                    [(check.what, f"{check.error:.2g}", f"{check.bound:.2g}", "yes" if check.passed else "**no**")
                     for check in finding.checks]),
             _table(["published", "this model", "verdict", "rule of the verdict"],
                    [(row.statement, row.ours, f"**{row.verdict}**",
                      "as above" if previous and previous.rule == row.rule else row.rule)
                     for previous, row in pairwise((None, *finding.claims)) if row]),
             f"![{finding.title}]({picture})", f"Missing: {finding.missing}"]
    return "\n\n".join(parts)


def overview(findings: list[Finding]) -> str:
    """Return a table in Markdown with the number of each verdict for each machine."""
    given = {claim.verdict for finding in findings for claim in finding.claims}
    verdicts = [verdict for verdict in VERDICTS if verdict in given]
    told = [(finding.title, finding.claims) for finding in findings]
    told.append(("all", tuple(claim for finding in findings for claim in finding.claims)))
    rows = [(title, *(str(sum(claim.verdict == verdict for claim in claims)) for verdict in verdicts))
            for title, claims in told]
    return _table(["statements about", *verdicts], rows)


def in_lines(finding: Finding) -> list[str]:
    """Return a finding as lines for a terminal."""
    checks = [f"  check: {check.what}: {check.error:.2g}, must be below {check.bound:.2g}" for check in finding.checks]
    claims = [f"  {claim.verdict}: {claim.statement}\n    {claim.ours}" for claim in finding.claims]
    return [f"{finding.name}: {finding.title}", *checks, *claims]


def _table(heads: list[str], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows])

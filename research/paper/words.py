"""The page of the study `paper`, in Markdown: every sentence with numbers is made of verdicts."""

from collections.abc import Iterable, Sequence

from research.paper.claims import CLAIMS, DIVERGES, DOES_NOT, HOLDS, NAMED, NOISE, Verdict, score
from research.paper.readings import BEST_ANGLE, SPANS, Point, Reading, Span
from research.paper.tables import (
    claims_table,
    rules,
    solver_in_words,
    speed_in_words,
    speed_table,
    verdict_table,
)
from research.paper.work import Work

#: Rules of the normal force under which the ground cannot pull: those that a machine may have.
PHYSICAL = ("unilateral", "hop")
#: Equations, rule and start of the tables of speeds.
_SPEED_TABLES = (("misprint", "printed", "rest"), ("corrected", "printed", "zero"), ("corrected", "unilateral", "zero"),
                 ("corrected", "unilateral", "rest"))
_ALL, _BEST = len(CLAIMS), Point("angle", BEST_ANGLE)


def page(told: Sequence[Verdict], starts: tuple[int, int], work: Work, pictures: Sequence[str]) -> str:
    """The whole page.

    Parameters
    ----------
    told : sequence of Verdict
        What came of every reading.
    starts : tuple of int
        Starts under readings by `exact`, and under the others.
    work : Work
        The misprint's work.
    pictures : sequence of str
        Paths of pictures to show, relative to the page.
    """
    exact = [one for one in told if one.reading.solver == "exact"]
    corrected, misprint = ([one for one in exact if one.reading.equations == equations]
                           for equations in ("corrected", "misprint"))
    worksheets = [one for one in told if one.reading.solver != "exact"]
    return "\n\n".join([
        "# The paper's claims, reading by reading",
        f"*Do the published optima follow from the published equations?* {short_answer(corrected, misprint)}",
        _bullets(answers(corrected, misprint, work)),
        "## Is it an index error in the worksheet?",
        "That the published optima come from such an error is a hypothesis, because the worksheet is not published.",
        "For the hypothesis:", _bullets(evidence_for(corrected, misprint)),
        "Against it, or open:", _bullets(evidence_against(misprint, worksheets)),
        "## What it means for a designer", _bullets(for_designers(corrected)),
        "## What is compared", claims_table(), rules(starts),
        "## The corrected equations, event by event", verdict_table(corrected),
        "## The misprint taken literally, event by event", verdict_table(misprint),
        "## As a worksheet integrates them", worksheet_words(worksheets), verdict_table(worksheets),
        "## Mean speeds by angle",
        "With 95 % intervals over the starts. The misprint's speeds grow with time, because a force that no mass pays "
        "drives the body on.", *(speed_table(exact, *choice) for choice in _SPEED_TABLES),
        "## The figures in the paper's layout",
        *(f"![The paper's four figures, {name}]({name})" for name in pictures)]) + "\n"


def all_and_forwards(told: Iterable[Verdict]) -> list[Verdict]:
    """Those by which every claim holds in the mean, at the named values at least, and every robot goes forwards."""
    return [one for one in told if score(one.along_ox) == _ALL and one.forwards[0] == len(one.means)]


def short_answer(corrected: Sequence[Verdict], misprint: Sequence[Verdict]) -> str:
    """The answer in two sentences."""
    right, wrong = all_and_forwards(corrected), all_and_forwards(misprint)
    return (f"From the equations as they should read, {_of(right, corrected)} combinations of rule, start and span "
            f"give all {_ALL} claims together, at the values that its text names, with robots that go forwards. With "
            f"the paper's misprint taken literally, {_of(wrong, misprint)} "
            f"do{f': from {_starts(wrong)}, over {_spans(wrong)}' if wrong else ''}.")


def answers(corrected: Sequence[Verdict], misprint: Sequence[Verdict], work: Work) -> list[str]:
    """What came out, in sentences."""
    best, most = max(score(one.along_ox) for one in corrected), max(score(one.size) for one in corrected)
    single = max(score(one.one_run) for one in corrected)
    back = sum(one.forwards[1] > one.forwards[0] for one in corrected)
    fastest = _find(misprint, "printed", "rest", SPANS[0]).means[_BEST]
    return [
        f"**The corrected equations** give at most {best} of {_ALL} claims, by "
        f"{_names([one for one in corrected if score(one.along_ox) == best])}. In one run, of the first start alone, "
        f"which proves less, it is at most {single}, by "
        f"{_names([one for one in corrected if score(one.one_run) == single])}. Under {back} of {len(corrected)} "
        "combinations more robots go backwards than forwards, and there *greatest speed along Ox* means *least "
        "backwards*. If the size of the speed is compared instead, whichever way the axis points, they give at most "
        f"{most} of {_ALL}.",
        f"**The misprint taken literally** gives all {_ALL}, with every robot going forwards, by "
        f"{_names(all_and_forwards(misprint)) or 'no reading'}.",
        f"**The misprint's speeds are absurd**: {speed_in_words(fastest.mean)} in the mean of the first second at φ = "
        f"80° from `rest`. In that second the motor gives {work.motor:.1f} J net, and {work.unpaid:.2g} J reach the "
        "body that no mass pays."]


def evidence_for(corrected: Sequence[Verdict], misprint: Sequence[Verdict]) -> list[str]:
    """What speaks for an index error in the worksheet."""
    one = _find(misprint, "printed", "rest", SPANS[0])
    forwards = {name: sum(v.forwards[0] == len(v.means) for v in told)
                for name, told in (("misprint", misprint), ("corrected", corrected))}
    wrong = all_and_forwards(misprint)
    return [
        f"Over the first second from `rest`, with N as printed, {score(one.along_ox)} of {_ALL} claims hold in the "
        f"mean of the starts and {score(one.one_run)} in the one run that the paper may have made. Of all angles, 85° "
        f"among them, {one.fastest('angle'):g}° is the fastest.",
        f"Every robot goes forwards under {forwards['misprint']} of {len(misprint)} combinations with the misprint, "
        f"and under {forwards['corrected']} of {len(corrected)} without it.",
        "The rule of the normal force, which the paper leaves open, hardly matters with the misprint: all claims come "
        f"out by {_listed(sorted({f'`{v.reading.normal_force}`' for v in wrong})) or 'none of the rules'}."]


def evidence_against(misprint: Sequence[Verdict], worksheets: Sequence[Verdict]) -> list[str]:
    """What speaks against it, or stays open."""
    by_span = [_find(misprint, "printed", "rest", span) for span in SPANS]
    by_start = {start: _find(misprint, "printed", start, SPANS[0]) for start in ("rest", "zero", "phase")}
    coarse = [v for v in worksheets if v.reading[2:] == ("misprint", "printed", "rest", "eq5") and v.span == SPANS[0]]
    return [
        _span_words(by_span),
        "The start matters. Over the first second, with N as printed, the claims that hold are "
        + _listed([f"{score(one.along_ox)} from `{start}`" for start, one in by_start.items()]) + f", of {_ALL}.",
        "The values matter. Of the claims that hold over the first second from `rest`, "
        f"{by_span[0].along_ox.count(NAMED)} hold at the values that the text names, and not at all values between and "
        "beyond.",
        "Somebody would have plotted, without a remark, a robot that is "
        f"{by_span[0].means[_BEST].mean:.0f} m away after a second, and whose mean speed is "
        + _listed([f"{speed_in_words(one.means[_BEST].mean)} over {_over(one.span)}" for one in by_span[:4]]) + ".",
        "The index may be a slip of the typesetter that the worksheet never had. The scales of the paper's figures "
        "would tell, and they are not in the text that was studied.",
        "The integration matters. Over the first second from `rest`, with N as printed, " + _listed(
            [f"{solver_in_words(v.reading)} diverges" if DIVERGES in v.along_ox else
             f"{solver_in_words(v.reading)} gives {score(v.along_ox)}" for v in coarse]) + f" of {_ALL} claims."]


def _span_words(by_span: Sequence[Verdict]) -> str:
    held = _listed([f"{score(one.along_ox)} over {_over(one.span)}" for one in by_span])
    angles = _listed([f"{one.fastest('angle'):g}°" for one in by_span])
    return (f"The span matters. From `rest`, with N as printed, the claims that hold are {held}, of {_ALL}. The "
            f"fastest angle over these spans is {angles}.")


def for_designers(corrected: Sequence[Verdict]) -> list[str]:
    """What a designer may take from the corrected equations, where the ground cannot pull."""
    physical = [one for one in corrected if one.reading.normal_force in PHYSICAL and one.span == SPANS[-1]]
    ends = [abs(one.means[_BEST].mean) for one in physical]
    by_start = {start: abs(_find(corrected, "unilateral", start, SPANS[-1]).means[_BEST].mean)
                for start in ("zero", "rest")}
    told = [
        "Do not build for 80°, 0.02 kg and 60 mm because of the published optima: without the misprint they are not "
        "the optima of the published equations.",
        f"Where the ground cannot pull ({_listed([f'`{rule}`' for rule in PHYSICAL])}), over {SPANS[-1]} and by the "
        f"size of the speed, the claims hold, do not, and are noise under so many of {len(physical)} readings: "
        + "; ".join(_counts(position, physical) for position in range(_ALL)) + ".",
        f"There the robot of φ = 80° makes {1e3 * min(ends):.0f} to {1e3 * max(ends):.0f} mm/s, not hundreds of m/s, "
        f"and {sum(one.forwards[1] for one in physical)} of {sum(len(one.means) for one in physical)} robots go "
        "against the paper's axis beyond their intervals.",
        f"The start matters as much as a parameter: by `unilateral`, the same robot makes {1e3 * by_start['zero']:.0f} "
        f"mm/s from `zero` and {1e3 * by_start['rest']:.0f} mm/s from `rest`, because nothing in the paper's scene "
        "damps the masses. Seek optima with dampers, the reaction on the masses and several starts, as `study "
        "optimise` does."]
    return told


def _counts(position: int, told: Sequence[Verdict]) -> str:
    outcomes = [one.size[position] for one in told]
    held = sum(outcome in (HOLDS, NAMED) for outcome in outcomes)
    return f"*{CLAIMS[position].name}* {held}, {outcomes.count(DOES_NOT)}, {outcomes.count(NOISE)}"


def worksheet_words(worksheets: Sequence[Verdict]) -> str:
    """What fixed and adaptive steps make of the claims."""
    solvers = dict.fromkeys((v.reading.solver, v.reading.step) for v in worksheets)
    counts = []
    for solver in solvers:
        own = [v for v in worksheets if v.reading[:2] == solver]
        diverging = sum(DIVERGES in v.along_ox for v in own)
        counts.append(f"By {solver_in_words(own[0].reading)} {diverging} of {len(own)} rows diverge, and "
                      f"{len(all_and_forwards(own)) or 'none'} give all claims with every robot going forwards.")
    return ("`rkfixed` is the classical Runge-Kutta method with every condition in the right-hand side, blind to "
            "events, and `Rkadapt` an embedded pair of orders 5 and 4 at MathCad's tolerance of 1e-3; neither shares "
            "code with `exact`. *Smooth* friction has x'/(|x'| + 1 mm/s) for sign(x'), *reversed* friction the other "
            f"sign. A contact lasts 0.3 ms. {' '.join(counts)}")


def _find(told: Iterable[Verdict], rule: str, start: str, span: Span) -> Verdict:
    [one] = [v for v in told if (v.reading.normal_force, v.reading.start, v.span) == (rule, start, span)]
    return one


def _bullets(lines: Iterable[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def _of(some: Sequence[Verdict], every: Sequence[Verdict]) -> str:
    return f"{len(some) or 'none'} of {len(every)}"


def _starts(told: Sequence[Verdict]) -> str:
    return _listed([f"`{start}`" for start in dict.fromkeys(one.reading.start for one in told)])


def _spans(told: Sequence[Verdict]) -> str:
    return _listed([_over(span) for span in SPANS if span in {one.span for one in told}])


def _over(span: Span) -> str:
    return f"{'' if span.begin else 'the '}{span}"


def _names(told: Sequence[Verdict]) -> str:
    """Readings and spans in words, grouped by rule and start."""
    groups: dict[Reading, list[Verdict]] = {}
    for one in told:
        groups.setdefault(one.reading, []).append(one)
    return "; ".join(f"`{reading.normal_force}` from `{reading.start}` over {_spans(own)}"
                     for reading, own in groups.items())


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)

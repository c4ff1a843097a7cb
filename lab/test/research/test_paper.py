"""The paper: claims on speeds with known outcomes, the worksheet compared with the robot, and the page."""

from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from research.paper import __main__ as command
from research.paper import worksheet
from research.paper.claims import (
    ANY_PHASE,
    CLAIMS,
    DIVERGES,
    DOES_NOT,
    HOLDS,
    INSTANTS,
    NAMED,
    NEAR_REST,
    NEAR_ZERO,
    NOISE,
    ON_SLIDERS,
    SERIES,
    SPANS,
    FigurePoint,
    Reading,
    instants,
    judged_pairs,
    mean_of,
    one_run_pairs,
    points,
    score,
    settled,
    single_scores,
    spans,
    speeds,
    verdicts,
)
from research.paper.page import SHOWN, all_and_forwards, file_name, page
from research.paper.runs import (
    NEAR,
    Batch,
    SimulationEffort,
    advance,
    displacements,
    full_effort,
    judged,
    masses_on_sliders,
    read_verdicts,
    write_verdicts,
)
from research.paper.worksheet import rkadapt, rkfixed
from tools.documents import without_marks

DOCS = Path(__file__).resolve().parents[3] / "docs"
TEXT = without_marks((DOCS / command.TEXT).read_text(encoding="utf-8"))
TABLE = DOCS / command.FOLDER / command.VERDICTS
JUDGEMENTS = read_verdicts(TABLE)
SINGLES = command.read_singles(DOCS / command.FOLDER / command.SINGLES)
MISPRINT = Reading("exact", 0.0, "misprint", "printed", NEAR_REST, "eq5")
BEST, FALLS, HEAVIER, LIGHTEST, LONGER = CLAIMS
STARTS = 16
READING = Reading("exact", 0.0, "corrected", "weight", NEAR_REST, "eq5")


def speed_of(series, mean):
    """Return speeds of every robot of a series, shape (starts,), with the given mean for each value."""
    draw = np.random.default_rng(7)
    return {FigurePoint(series, value): mean(value) + 0.01 * draw.standard_normal(STARTS) for value in SERIES[series]}


@pytest.mark.parametrize(("claim", "mean", "outcome"), [
    (BEST, lambda angle: -abs(angle - 80.0), HOLDS), (BEST, lambda angle: -abs(angle - 84.0), NAMED),
    (BEST, lambda angle: angle, DOES_NOT), (BEST, lambda angle: 0.0, NOISE),
    (BEST, lambda angle: -abs(angle - 75.0), NOISE),  # 70 and 80 are equal, and nothing is faster than 80
    (FALLS, lambda angle: -angle, HOLDS), (FALLS, lambda angle: abs(angle - 94.0), NAMED),
    (FALLS, lambda angle: angle, DOES_NOT),
    (HEAVIER, lambda mass: -mass, HOLDS), (HEAVIER, lambda mass: -abs(mass - 0.1), NAMED),
    (LIGHTEST, lambda mass: -mass, HOLDS), (LIGHTEST, lambda mass: float(mass == 0.05) - mass, NAMED),
    (LONGER, lambda crank: crank, NAMED), (LONGER, lambda crank: 10.0 * crank, HOLDS),
    (LONGER, lambda crank: 10.0 * abs(crank - 0.015), NAMED), (LONGER, lambda crank: -10.0 * crank, DOES_NOT)])
def test_outcome_of_a_claim(claim, mean, outcome):
    """Sixteen starts have speeds that scatter by 0.01 m/s."""
    assert settled(claim, speed_of(claim.series, mean), judged_pairs) == outcome


def test_pure_noise_hardly_ever_settles_a_claim():
    """Without a true difference, some pair is found the other way round in at most 5 % of the studies, and all pairs
    never hold.
    """
    draw = np.random.default_rng(11)
    outcomes = [judged_pairs(draw.standard_normal((5, STARTS))) for _ in range(2000)]
    assert outcomes.count(DOES_NOT) < 0.065 * len(outcomes) and outcomes.count(HOLDS) == 0


def test_what_diverges_is_told():
    speed = speed_of("angle", lambda angle: -abs(angle - 80.0))
    for value in (np.inf, np.nan, -1e40):
        speed[FigurePoint("angle", 60.0)][3] = value
        assert settled(BEST, speed, judged_pairs) == DIVERGES and settled(BEST, speed, one_run_pairs) == HOLDS


def test_backwards_is_not_forwards_but_may_be_fast():
    """A robot that goes backwards may obey every claim by the size of its speed."""
    def speed(point):
        order = {"angle": 200.0 - abs(point.value - 80.0), "mass": 200.0 - 100.0 * point.value,
                 "crank": 1e3 * point.value}
        return -order[point.series]

    draw = np.random.default_rng(5)
    displaced = {point: np.outer(speed(point) + 0.01 * draw.standard_normal(STARTS), INSTANTS) for point in points()}
    for verdict in verdicts(READING, displaced):
        assert score(verdict.size) == len(CLAIMS) and score(verdict.along_ox) == 0
        assert verdict.forwards == (0, len(displaced)) and verdict.fastest("crank") == 0.01


REST = Reading("exact", 0.0, "corrected", "printed", NEAR_REST, "eq5")
COARSE = Reading("rkfixed", 1e-3, "misprint", "printed", NEAR_ZERO, "eq5")
SMALL = SimulationEffort((COARSE, COARSE._replace(start=NEAR_REST)), 2, 3)


def test_the_first_start_is_the_named_state_and_the_others_are_near_it():
    assert advance(NEAR_ZERO, 0) == advance(NEAR_REST, 0) == 0.0
    ahead = [advance(NEAR_REST, number) for number in range(1, 200)]
    assert 0.0 < min(ahead) and max(ahead) < NEAR and len(set(ahead)) == len(ahead)
    scene = REST.scene(FigurePoint("angle", 80.0))
    named = vibro_ros.Simulator(scene).sample(np.array(instants(REST))).body_position
    np.testing.assert_array_equal(displacements(Batch(REST, FigurePoint("angle", 80.0), 1))[0], named)


@pytest.mark.parametrize("start", [NEAR_REST, ON_SLIDERS])
def test_masses_rest_where_the_sliders_were_or_where_they_are(start):
    """At the crank's angle of 0.05 rad the inclined slider is 1 mm further, by the crank's geometry at φ = 80°."""
    scene = REST._replace(start=start).scene(FigurePoint("angle", 80.0)).with_parameters({"inclined.gap": 0.005})
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=1e4)
    device.advance_to(0.05 / 1e4)
    earlier_position = device.state.inclined_position
    if start == ON_SLIDERS:
        device.set_state(**masses_on_sliders(device))
        assert device.state.inclined_velocity == device.state.upper_velocity == 0.0
        assert device.state.inclined_drive_force == pytest.approx(0.0, abs=1e-6)
        assert device.state.upper_position == pytest.approx(0.06, abs=1e-6)  # its plate
    moved = device.state.inclined_position - earlier_position
    assert moved == pytest.approx(0.001 if start == ON_SLIDERS else 0.0, abs=3e-4)


def test_a_phase_is_where_the_upper_slider_moves():
    phases = np.array([advance(ANY_PHASE, number) for number in range(400)])
    assert (np.cos(phases) > 0.0).all() and (np.sin(phases) > 0.9).any() and (np.sin(phases) < -0.9).any()


@pytest.mark.parametrize("start", [NEAR_ZERO, NEAR_REST, ANY_PHASE])
def test_starts_of_a_crank_as_long_as_its_rods_differ(start):
    """They differ from the first second on."""
    displaced = displacements(Batch(REST._replace(start=start), FigurePoint("crank", 0.06), 6))[:, 0]
    assert np.min(np.abs(np.subtract.outer(displaced, displaced)) + np.eye(6)) > 1e-6


def test_masses_at_rest_on_a_slider_that_stands_still_make_copies():
    """With φ = 80° both sliders stand at 0 from 170° to 270°: a start 0.3 rad further repeats the same motion 3 ms
    sooner.
    """
    scene, times = REST._replace(start=NEAR_ZERO).scene(FigurePoint("crank", 0.06)), np.array([0.05, 0.06])
    first = worksheet.rkfixed(scene, "eq5", 3.3, 1e-5, times + 0.003)
    np.testing.assert_allclose(worksheet.rkfixed(scene, "eq5", 3.6, 1e-5, times), first, rtol=1e-6)
    assert np.abs(worksheet.rkfixed(scene, "eq5", 0.3, 1e-5, times) - first).max() > 1e-4


def test_every_reading_of_an_effort_is_judged_in_its_order():
    judgements = judged(SMALL)
    assert [(verdict.reading, verdict.span) for verdict in judgements] == [
        (reading, span) for reading in SMALL.readings for span in spans(reading)]
    displaced = displacements(Batch(SMALL.readings[1], FigurePoint("crank", 0.06), 3))
    np.testing.assert_equal(judgements[-1].means[FigurePoint("crank", 0.06)],
                            mean_of(speeds(displaced, judgements[-1].span)))


TIMES = np.array([0.05, 0.1])


FIRST = FigurePoint("angle", 60.0)


def scene_of(equations, rule, start, point=FIRST):
    return Reading("rkfixed", 1e-6, equations, rule, start, "eq5").scene(point)


@pytest.mark.parametrize("equations", ["corrected", "misprint"])
@pytest.mark.parametrize("rule", ["printed", "unilateral", "weight"])
@pytest.mark.parametrize("start", [NEAR_ZERO, NEAR_REST])
def test_fine_steps_find_the_motion_of_the_robot(equations, rule, start):
    """The difference is due to events within steps of 1e-6 s: a force of 1e4 N (1e5 N with the misprint) acts for up to
    a step too long.
    """
    scene = scene_of(equations, rule, start)
    exact = vibro_ros.Simulator(scene).sample(TIMES).body_position
    by_steps = rkfixed(scene, "eq5", 0.0, 1e-6, TIMES)
    allowed = 1e-2 * np.abs(exact).max() if equations == "misprint" else 2e-4
    np.testing.assert_allclose(by_steps, exact, rtol=0.0, atol=allowed)
    assert np.abs(exact).max() > 1e-4


def test_steps_longer_than_a_contact_diverge():
    """A contact of 0.3 ms on 1e7 N/m is unstable with steps of 1 ms."""
    by_steps = rkfixed(scene_of("misprint", "printed", NEAR_REST), "eq5", 0.0, 1e-3, np.array([1.0]))
    assert not abs(by_steps[0]) < 1e6


def test_adaptive_steps_find_the_first_turn():
    """To some per cent, because the tolerance is 1e-3."""
    scene = scene_of("misprint", "printed", NEAR_REST)
    exact = vibro_ros.Simulator(scene).sample(TIMES).body_position
    np.testing.assert_allclose(rkadapt(scene, "eq5", 0.0, TIMES), exact, rtol=0.5)


def test_the_page_is_the_one_that_its_verdicts_make(tmp_path):
    """All but the energy, which is computed again; its printed digits are the same on any machine."""
    assert page(JUDGEMENTS, SINGLES, full_effort(), command.FOLDER) == TEXT, "run `make paper`"
    write_verdicts(tmp_path / "again.csv", JUDGEMENTS)
    assert (tmp_path / "again.csv").read_bytes() == TABLE.read_bytes()
    for reading in SHOWN:
        assert (DOCS / command.FOLDER / file_name(reading)).read_bytes().startswith(b"\x89PNG")


def of(reading, span):
    [verdict] = [verdict for verdict in JUDGEMENTS if (verdict.reading, verdict.span) == (reading, span)]
    return verdict


def test_every_reading_has_a_verdict_for_each_of_its_spans():
    wanted = [(reading, span) for reading in full_effort().readings for span in spans(reading)]
    assert [(verdict.reading, verdict.span) for verdict in JUDGEMENTS] == wanted


@pytest.mark.parametrize(("reading", "spans"), [
    (MISPRINT, SPANS[:2]), (MISPRINT._replace(equations="corrected", start=NEAR_ZERO), SPANS[:2]),
    (MISPRINT._replace(equations="corrected", normal_force="unilateral"), SPANS[:1])])
@pytest.mark.parametrize("point", [FigurePoint("angle", 80.0), FigurePoint("mass", 0.02)])
def test_mean_speeds_of_the_first_seconds_are_found_again(reading, spans, point):
    """Over as long as chaos leaves five digits: two seconds, and one by `unilateral`, where a start that is moved by
    1e-15 of itself changes its speed by up to 1e-11 m/s over one second, but by 3e-6 m/s over two.
    """
    displaced = displacements(Batch(reading, point, full_effort().exact_starts))
    for span in spans:
        mean, spread = mean_of(speeds(displaced, span))
        stored = of(reading, span).means[point]
        assert stored.mean == pytest.approx(mean, rel=1e-5, abs=1e-8)
        assert stored.spread == pytest.approx(spread, rel=1e-4, abs=1e-8)


def test_the_answer_is_what_the_verdicts_say():
    """The counts in the first paragraph are those of the verdicts."""
    exact = [verdict for verdict in JUDGEMENTS
             if verdict.reading.solver == "exact" and verdict.reading.start != ON_SLIDERS]
    every = {equations: [verdict for verdict in exact if verdict.reading.equations == equations]
             for equations in ("corrected", "misprint")}
    full = {equations: sum(all(outcome in (HOLDS, NAMED) for outcome in verdict.along_ox)
                           and all(mean.mean > mean.spread for mean in verdict.means.values()) for verdict in verdicts)
            for equations, verdicts in every.items()}
    head = " ".join(TEXT.partition("## ")[0].split())
    assert f"{full['corrected'] or 'none'} of {len(every['corrected'])} combinations give all 5 claims" in head
    single = {equations: sum(score(verdict.one_run) == len(CLAIMS) for verdict in verdicts)
              for equations, verdicts in every.items()}
    assert f"of our starts alone, {single['corrected']} of {len(every['corrected'])} comb" in head
    said = [f"{single.full} of {single.runs} single runs by `{single.normal_force}`" for single in SINGLES]
    assert len(said) == 2 and all(words in head for words in said)
    assert f"{single['misprint']} of {len(every['misprint'])} with the misprint" in head
    assert f"{full['misprint'] or 'none'} of {len(every['misprint'])} do" in head
    assert full["misprint"] == len(all_and_forwards(every["misprint"]))


def test_a_single_run_that_gives_every_claim_is_one_of_few():
    """The first start of `hop` at any phase gives all claims, but few of the stored runs do."""
    hop = MISPRINT._replace(equations="corrected", normal_force="hop", start=ANY_PHASE)
    verdict = next(verdict for verdict in JUDGEMENTS if (verdict.reading, verdict.span) == (hop, SPANS[0]))
    again = {point: displacements(Batch(verdict.reading, point, 3, SPANS[0].end)) for point in points()}
    assert single_scores(again, SPANS[0])[0] == len(CLAIMS)
    [of_hop] = [single for single in SINGLES if single.normal_force == "hop"]
    assert 0 < of_hop.full < 0.25 * of_hop.runs


def test_only_the_misprint_gives_every_claim():
    """Every reading that gives all claims, those with fixed steps included, has the misprint."""
    full = all_and_forwards(JUDGEMENTS)
    assert full and {verdict.reading.equations for verdict in full} == {"misprint"}
    assert min(verdict.means[FigurePoint("angle", 80.0)].mean for verdict in full) > 100.0  # m/s

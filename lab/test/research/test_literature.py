"""The model contains the published machines, agrees with closed forms and scipy, and the document states its findings.
"""

import dataclasses
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from research.literature import __main__ as literature
from research.literature import capsule, gap_speed, measured, two_phase
from research.literature.capsule_equations import Capsule, harmonic, integrate
from research.literature.findings import (
    FAILS,
    HOLDS,
    MISSIGNED,
    NOISE,
    OUTSIDE,
    VERDICTS,
    Check,
    Claim,
    Finding,
    Mapped,
    Studied,
)
from research.literature.impact_oscillator import (
    Oscillator,
    doubling,
    followed,
    verdict_of_tilt,
)
from tools.documents import without_marks

DOCS = Path(__file__).resolve().parents[3] / "docs"
FINDINGS = literature.read_findings(DOCS / literature.FOLDER / literature.DATA)
QUIET = dataclasses.replace(capsule.REFERENCE, alpha=0.05)


def test_scipys_free_mass_is_the_driven_oscillator():
    """For a capsule at rest, z = C (cos ω τ - cos τ) with C = α/(1 - ω²)."""
    machine = Capsule(alpha=0.1, omega=0.5, beta=0.0, gamma=1.0, delta=10.0, xi=0.0)
    times = np.linspace(0.0, 20.0, 101)
    expected = 0.1 / (1.0 - 0.25) * (np.cos(0.5 * times) - np.cos(times))
    np.testing.assert_allclose(integrate(machine, times, harmonic(machine, 0.0))[:, 0], expected, atol=1e-9)


def test_a_capsule_with_wheels_that_turn_one_way_never_moves_backwards():
    times = np.linspace(0.0, 5 * capsule.REFERENCE.period, 400)
    both_ways, one_way = (integrate(dataclasses.replace(capsule.REFERENCE, grip=grip, gamma=1.0), times,
                           harmonic(capsule.REFERENCE, 0.0))[:, 2] for grip in (1.0, math.inf))
    assert np.min(np.diff(both_ways)) < -1e-3
    assert np.min(np.diff(one_way)) > -1e-9
    assert one_way[-1] > both_ways[-1]


def test_a_slide_within_a_step_ends_after_it_began():
    """This capsule slides back for less than a step; an integration with one step would never leave the start of the
    slide.
    """
    machine = dataclasses.replace(capsule.machines(16)[5], gamma=2.0)
    times = machine.period * np.array([1.0, 2.0])
    states = integrate(machine, times, harmonic(machine, -math.pi / 2.0, reaction=0.0), tolerance=1e-6)
    assert np.all(np.isfinite(states))


def test_the_closed_form_is_the_zero_of_the_mean_friction():
    press, quadrature = 0.6, 0.7
    speed = two_phase.closed_form(press)
    phase = (np.arange(1_000_000) + 0.5) * 2.0 * math.pi / 1_000_000
    friction = np.sign(speed + np.cos(phase)) * (1.0 + press * np.cos(phase) + quadrature * np.sin(phase))
    assert abs(np.mean(friction)) < 1e-5


def test_a_gap_that_is_never_bridged_moves_as_without_the_plate():
    [wide], [without] = (gap_speed.motions(gap, 60.0, 2) for gap in (0.058, math.inf))
    assert wide.approach == without.approach == 0.0 < wide.speed == pytest.approx(without.speed)
    assert wide.share == 1.0 and wide.words == "53.72 mm/s, again after 1 turn (2 of 2 starts, 34 to 100 %)"


def test_two_motions_of_a_gap_are_two_rows_with_their_own_impacts():
    """At 4 mm one of 16 starts, start 4, leads to a faster motion with harder impacts."""
    slow, fast = gap_speed.motions(0.004, 100.0, 16)
    assert (slow.share, fast.share) == (15 / 16, 1 / 16) and slow.spread == fast.spread == 0.0
    assert (slow.speed, fast.speed) == pytest.approx((0.20245, 0.24834), abs=1e-5)
    assert slow.approach + 1.0 < fast.approach
    assert "- 4 mm, 100 rad/s: 202.45 mm/s, again after 1 turn (15 of 16 starts" in gap_speed._several([slow, fast], 16)


def row(gap, speed, approach, spread=0.0, share=1.0):
    return gap_speed.Moved(gap, 100.0, speed, spread, share, f"{1e3 * speed:g} mm/s ({share:.0%})", approach)


@pytest.mark.parametrize(("last", "verdict"), [
    (row(0.02, 0.05, 3.0), HOLDS), (row(0.02, 0.02, 3.0), FAILS), (row(0.02, 0.02, 3.0, 0.1), NOISE)])
def test_the_verdict_of_a_curve(last, verdict):
    curve = [row(0.0, 0.04, 1.0), row(0.01, 0.03, 1.5), last]
    assert gap_speed.claim(curve).verdict == verdict
    assert gap_speed.claim(curve).ours.endswith("an end of the scan, so that no best gap is known")


def test_a_best_gap_within_the_scan_is_no_end_and_a_rare_motion_does_not_judge():
    curve = [row(0.0, 0.03, 1.0), row(0.01, 0.05, 1.5, share=0.75), row(0.01, 0.09, 0.1, share=0.25),
             row(0.02, 0.04, 1.2), row(math.inf, 0.08, 0.0)]
    judged = gap_speed.claim(curve)
    assert "an end" not in judged.ours and judged.verdict == HOLDS
    assert "fastest at 10 mm, 50 mm/s (75%)" in judged.ours


def test_an_end_of_the_scan_names_the_speed_without_the_plate():
    curve = [row(0.0, 0.03, 1.0), row(0.01, 0.05, 0.9), row(math.inf, 0.08, 0.0)]
    assert gap_speed.claim(curve).ours.endswith("is known; without any plate it moves at 80 mm/s (100%)")


@pytest.mark.parametrize(("side", "slope", "orbits", "verdict"), [
    (-1.0, -11.0, (False, True), MISSIGNED), (1.0, -11.0, (False, True), HOLDS), (-1.0, 11.0, (False, True), FAILS),
    (1.0, -11.0, (True, True), FAILS), (1.0, 11.0, (True, False), MISSIGNED)])
def test_a_tilt_has_a_wrong_sign_only_where_closed_form_and_orbits_agree(side, slope, orbits, verdict):
    assert verdict_of_tilt(side, slope, dict(zip((-1.0, 1.0), orbits, strict=True))) == verdict


def test_the_closed_form_is_a_periodic_motion():
    """x = cos ωt/(1 - ω²) + a free oscillation returns to the stop after n turns with the speed of the impact."""
    oscillator, turns = Oscillator(1.9, 0.3, 0.8), 1
    speed, (a, _) = oscillator.speeds(turns)[0], oscillator.shape(turns)
    period = 2.0 * math.pi * turns / oscillator.omega
    free = -a * speed  # σ less the driven part at the impact
    forced = oscillator.sigma - free
    forced_speed = (1.0 - oscillator.restitution) * speed / 2.0
    free_speed = -oscillator.restitution * speed - forced_speed
    assert forced**2 + (forced_speed / oscillator.omega)**2 == pytest.approx(oscillator.reach**2)
    assert free * math.cos(period) + free_speed * math.sin(period) == pytest.approx(free)
    assert -free * math.sin(period) + free_speed * math.cos(period) + forced_speed == pytest.approx(speed)


def test_a_multiplier_is_one_at_the_fold():
    oscillator = Oscillator(1.9, 0.0, 0.8)
    at_fold = replace(oscillator, sigma=oscillator.fold(1) * (1.0 - 1e-12))
    assert np.max(np.real(at_fold.multipliers(1, at_fold.speeds(1)[0]))) == pytest.approx(1.0, abs=1e-4)
    beyond = replace(oscillator, sigma=oscillator.fold(1) * 1.001)
    assert all(map(math.isnan, beyond.speeds(1)))


def test_the_orbit_ends_at_the_fold_and_doubles_where_a_multiplier_is_minus_one():
    folding, fold = Oscillator(1.9, 0.0, 0.8), Oscillator(1.9, 0.0, 0.8).fold(1)
    beside_fold = [followed(replace(folding, sigma=fold * share), 0.0) for share in (0.99, 1.01)]
    assert [motion.impacts == 1 for motion in beside_fold] == [True, False]
    oscillator = Oscillator(2.8, 0.0, 0.8)
    place = doubling(oscillator, 1, -0.07, 0.0)
    motions = [followed(replace(oscillator, sigma=place + step), place - 0.01) for step in (-0.003, 0.003)]
    assert [(motion.impacts, motion.turns) for motion in motions] == [(1, 1), (2, 2)]


def test_the_document_is_what_the_findings_say():
    assert without_marks((DOCS / literature.TEXT).read_text(encoding="utf-8")) == literature.document(FINDINGS)


def test_the_document_has_every_study_a_passed_check_each_and_known_verdicts():
    assert [finding.name for finding in FINDINGS] == list(literature.PUBLISHED)
    for finding in FINDINGS:
        assert finding.checks and all(check.passed for check in finding.checks)
        assert {claim.verdict for claim in finding.claims} <= set(VERDICTS)
        assert (DOCS / literature.picture(finding.name)).is_file()


def test_a_measured_robot_is_cited_with_what_was_read_and_what_is_missing():
    """A row without a reference, or with nothing missing, would promise a comparison that nobody made."""
    for row in measured.SOURCES:
        assert "](https://" in row.source or "IOSR J. Mech. Civ. Eng." in row.source
        assert "abstract" in row.read and row.reports and row.missing
        assert row.source in (DOCS / literature.TEXT).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", literature.PUBLISHED)
def test_a_short_study_finds_what_the_document_says(name, tmp_path):
    """The quick run has fewer scenes, so that a verdict may be `NOISE`; its checks are those by other integrators."""
    assert literature.main([name, "--quick", "--output", str(tmp_path)]) == 0
    [quick] = literature.read_findings(tmp_path / literature.FOLDER / literature.DATA)
    stored = next(finding for finding in FINDINGS if finding.name == quick.name)
    assert quick.checks and all(check.passed for check in quick.checks)
    for claim, stored_claim in zip(quick.claims, stored.claims, strict=True):
        assert claim.statement == stored_claim.statement and claim.verdict in (stored_claim.verdict, NOISE)
    assert quick.mapping == stored.mapping and quick.sources == stored.sources


def test_a_study_that_fails_keeps_those_before_it(monkeypatch, tmp_path, capsys):
    def failing(quick):
        raise RuntimeError("the capsule at 3: no step")

    finding = Finding("one", "One", ("A source",), "Contained.", (Mapped("a", "b", "c"),), (Check("what", 1.0, 2.0),),
                  (Claim("said", "found", OUTSIDE, "rule"),), "nothing.")
    monkeypatch.setattr(literature, "PUBLISHED", {"one": lambda quick: Studied(finding, Figure), "two": failing})
    assert literature.main(["--output", str(tmp_path)]) == 1
    assert capsys.readouterr().err == "literature: the capsule at 3: no step; 1 of 2 studies are kept\n"
    assert literature.read_findings(tmp_path / literature.FOLDER / literature.DATA) == [finding]

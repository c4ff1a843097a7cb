"""Text about measured rows: advice, slopes, headlines and findings."""

import pytest

from vibro_lab.accuracy.harness import AVERAGE, CANNOT, REFERENCE, REQUIRED, Row
from vibro_lab.accuracy.programs import PLAIN, TUNED
from vibro_lab.accuracy.report import (
    MEAN_SPEED,
    REQUIREMENTS,
    advice,
    cheapest,
    finding,
    headline,
    slope_of_scene,
    slope_over_scenes,
    slopes_in_words,
    speeds_table,
    unit_error,
    unit_in_words,
)
from vibro_lab.accuracy.scene_rows import SHORT, LyapunovTime


def test_advice_is_what_was_measured_within_the_horizon_of_each_requirement(rows):
    advised = advice(rows)
    assert list(advised) == [*(asked.words for asked in REQUIREMENTS), MEAN_SPEED]
    assert all(text.startswith("exact") for text in advised.values())
    for asked in REQUIREMENTS:
        for row in cheapest(rows, asked).values():
            assert (row.compared, row.horizon) == (REQUIRED, asked.horizon)
            assert getattr(row, asked.column) < asked.limit
    assert "rk4" in advised[REQUIREMENTS[0].words] and "planted" not in str(advised)
    chaotic = [LyapunovTime(5.0, 0.1, True, 15.0).row("damped"), *rows[1:]]
    assert advice(chaotic)[REQUIREMENTS[-1].words] == "not possible: chaos"


def within(compared, program, value, body, height=0.0, masses=0.0, cost=1.0):
    return Row("s", compared, program, TUNED, f"step {value:g} s", value, SHORT, 1, wall_time=cost, cost=cost,
               body_error=body, height_error=height, mass_error=masses)


def measured_within(step, error, height=0.0, masses=0.0):
    return within(REQUIRED, "rk4", step, error, height, masses, cost=1e-6 / step)


KNOWN = within(REFERENCE, "heyoka", 1e-15, 1e-12)


def test_a_step_that_is_accurate_by_luck_is_not_advised():
    asked = REQUIREMENTS[0]  # 1 mm
    lucky = [KNOWN, *map(measured_within, (1e-3, 1e-4, 1e-5, 1e-6), (1e-4, 1e-2, 1e-4, 1e-5))]
    assert cheapest(lucky, asked)["rk4"].value == 1e-5
    assert cheapest([*lucky, measured_within(1e-7, 1.0)], asked) == {}
    blurred = within(REFERENCE, "rk4_located", 1e-6, 1e-2)
    assert cheapest([blurred, *lucky[1:]], asked) == {}


@pytest.mark.parametrize("column", range(3))
def test_every_position_is_that_of_body_height_and_masses(column):
    far = [2e-3 if k == column else 1e-5 for k in range(3)]
    rows = [KNOWN, measured_within(1e-4, *far), measured_within(1e-5, 1e-5, 1e-5, 1e-5)]
    assert rows[1].position_error == 2e-3
    assert cheapest(rows, REQUIREMENTS[0])["rk4"].value == 1e-5
    assert rows[1].path_error == (1e-5 if column == 2 else 2e-3)
    unknown = Row("s", REQUIRED, "rk4", TUNED, "", 1e-4, SHORT, 1, body_error=0.0, mass_error=0.0)
    assert not unknown.position_error < 1.0


def ladder(program, slope, constant, noise=(0.0,)):
    """Return rows whose cost rises by a factor of 10**slope for each digit."""
    return [within(REQUIRED, program, error, error, cost=constant * error**-slope * 10.0**off)
            for error, off in zip((1e-3, 1e-4, 1e-5, 1e-6), 4 * noise, strict=False)]


def test_what_a_digit_costs_is_the_slope():
    both = [KNOWN, *ladder("rk4", 0.5, 1e-3), *ladder("scipy", 0.1, 3.0)]
    slope = slope_of_scene(both, "rk4")
    assert (slope.factor, slope.spread) == (pytest.approx(10**0.5), pytest.approx(0.0, abs=1e-6))
    assert slope_of_scene(both, "scipy").factor == pytest.approx(10**0.1)
    assert slope_of_scene(both, "heyoka") is None
    useless = [within(REQUIRED, "rk4", 1.0, 0.5, cost=1e-9), within(REQUIRED, "rk4", 1e-9, 1e-12, cost=1e9)]
    assert slope_of_scene([*both, *useless], "rk4") == slope  # neither lost from the start nor at rounding
    noisy = slope_of_scene([KNOWN, *ladder("rk4", 0.5, 1e-3, noise=(0.1, -0.1))], "rk4")
    assert abs(noisy.slope - 0.5) < noisy.spread < 1.0
    several = slope_over_scenes({"a": both, "b": [KNOWN, *ladder("rk4", 0.7, 1e-3)]}, "rk4")
    assert several.slope == pytest.approx(0.6)
    assert several.spread == pytest.approx(12.706 * 0.1, rel=1e-4)  # Student's, of two
    assert several.problems == 2 and "over 2 related scenes) between errors of 1e-03 and 1e-06 m" in str(several)


def test_a_headline_is_a_quotient_of_two_rows():
    """A headline is the quotient of `exact` and Runge-Kutta by hand in one scene, or a ratio to the unit if the latter
    was not measured.
    """
    exact, hand = within(REQUIRED, "exact", 1e-9, 0.0, cost=0.05), within(REQUIRED, "rk4_by_hand", 1e-5, 1e-4, cost=0.4)
    assert headline({"s": [exact, hand]}, "exact", SHORT).startswith("0.12 of Runge-Kutta 4 of 1e-05 s written by hand")
    both = headline({"s": [exact, hand], "machine": [exact]}, "exact", SHORT)
    assert both.endswith("and 0.05 of the device's own Runge-Kutta 4 (`solver.method: rk4`) of 1e-5 s (`machine`)")


def test_the_report_begins_with_what_a_digit_costs(rows):
    said = slopes_in_words({"damped": rows})
    assert said[0].startswith("`exact` has no setting, but one cost, ") and "costs nothing" not in " ".join(said)
    assert any(text.startswith("One more digit of every position by `rk4` costs ") for text in said)
    off = unit_error(rows)
    assert 1e-6 < off < 1e-2
    assert f"which is itself off by {off:.1e} m within 0.2 s" in unit_in_words({"damped": rows})


def speeds(*values):
    exact = Row("s", AVERAGE, "exact", PLAIN, "", float("nan"), 20.0, 16, mean=-0.1, spread=0.001)
    return [exact, *(Row("s", AVERAGE, "rk4", PLAIN, "", step, 20.0, 16, mean=speed, spread=0.001,
                         starts_forwards=16 if speed > 0.0 else 0)
                     for step, speed in zip((1e-3, 1e-4, 1e-5), values, strict=True))]


def test_the_finding_names_the_coarsest_step_from_which_all_are_right():
    text = finding(speeds(0.05, -0.2, -0.101))
    assert "from dt = 1e-05 s down" in text and "0.001 s: 50.00 ± 1 mm/s, -150%, WRONG SIGN (16 of 16" in text
    assert "WRONG" not in text.partition("0.0001 s")[2]
    assert "at no step tried" in finding(speeds(-0.1, -0.1, -0.2))  # right by accident
    assert "allows for 6%" in finding(speeds(0.05, -0.2, -0.1045))
    table = speeds_table(speeds(0.05, -0.2, -0.101))
    assert "| +50.0 ± 1.0 (!) | -200.0 ± 1.0 | **-101.0 ± 1.0** |" in table


def test_what_failed_does_not_say_that_nothing_touches():
    failed = [LyapunovTime(0.0, 0.0, False, 15.0).row("s"),
              Row("s", REQUIRED, "heyoka", TUNED, "", 1e-9, SHORT, outcome=CANNOT, note="not installed")]
    assert set(advice(failed).values()) == {"nothing that was measured", "not measured"}

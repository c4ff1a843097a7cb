"""What is said of measured rows: advice, the price of a digit, findings and reports."""

import pytest
from quick_study import QUICK

from tools import accuracy_report
from vibro_ros.accuracy import accuracy
from vibro_ros.accuracy.findings import (
    MEAN_SPEED,
    NEEDS,
    advice,
    baseline_in_words,
    cheapest,
    finding,
    price_of_a_digit,
    price_over_scenes,
    prices_in_words,
    speeds_table,
)
from vibro_ros.accuracy.measurement import AVERAGE, NEED, REFERENCE, Measurement
from vibro_ros.accuracy.precision import SHORT, Growth


def test_advice_is_what_was_measured_within_the_horizon_of_each_need(rows):
    # Without heyoka no reference is sure to hold for 10 s, and there is no advice for that need.
    pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, has no wheel for Python 3.10")
    advised = advice(rows, comparable=15.0)
    assert list(advised) == [*(need.words for need in NEEDS), MEAN_SPEED]
    assert all(text.startswith("exact") for text in advised.values())
    for need in NEEDS:
        for row in cheapest(rows, need).values():
            assert row.compared == NEED and row.horizon == need.horizon and getattr(row, need.column) < need.limit
    assert "rk4" in advised[NEEDS[0].words] and "planted" not in str(advised)
    assert advice(rows, comparable=1.0)[NEEDS[-1].words] == "not possible: chaos"


def within(compared, method, setting, value, body, height=0.0, masses=0.0, cost=1.0):
    return Measurement("s", compared, method, setting, value, SHORT, 1, wall_time=cost, cost=cost, body_error=body,
               height_error=height, mass_error=masses)


def measured_within(step, error, height=0.0, masses=0.0):
    return within(NEED, "rk4", "step", step, error, height, masses, cost=1e-6 / step)


def test_a_step_that_is_accurate_by_luck_is_not_advised():
    reference = within(REFERENCE, "heyoka", "tolerance", 1e-15, 1e-12)
    need = NEEDS[0]  # 1 mm
    lucky = [reference, *map(measured_within, (1e-3, 1e-4, 1e-5, 1e-6), (1e-4, 1e-2, 1e-4, 1e-5))]
    assert cheapest(lucky, need)["rk4"].value == 1e-5
    assert cheapest([*lucky, measured_within(1e-7, 1.0)], need) == {}
    blurred = within(REFERENCE, "DOP853", "tolerance", 1e-13, 1e-2)
    assert cheapest([blurred, *lucky[1:]], need) == {}


@pytest.mark.parametrize("column", range(3))
def test_every_position_is_that_of_body_height_and_masses(column):
    reference = within(REFERENCE, "heyoka", "tolerance", 1e-15, 1e-12)
    far = [2e-3 if k == column else 1e-5 for k in range(3)]
    rows = [reference, measured_within(1e-4, *far), measured_within(1e-5, 1e-5, 1e-5, 1e-5)]
    assert rows[1].position_error == 2e-3
    assert cheapest(rows, NEEDS[0])["rk4"].value == 1e-5
    assert rows[1].path_error == (1e-5 if column == 2 else 2e-3)
    unknown = Measurement("s", NEED, "rk4", "step", 1e-4, SHORT, 1, body_error=0.0, mass_error=0.0)
    assert not unknown.position_error < 1.0


def ladder(method, slope, constant, compared=NEED, noise=(0.0,)):
    """Rows whose cost rises by 10**slope for each digit."""
    return [within(compared, method, "step", error, error, cost=constant * error**-slope * 10.0**off)
            for error, off in zip((1e-3, 1e-4, 1e-5, 1e-6), 4 * noise, strict=False)]


def test_the_price_of_a_digit_is_the_slope():
    reference = within(REFERENCE, "heyoka", "tolerance", 1e-15, 1e-12)
    both = [reference, *ladder("rk4", 0.5, 1e-3), *ladder("DOP853", 0.1, 3.0), *ladder("LSODA", 0.1, 50.0)]
    price = price_of_a_digit(both, ("rk4",))
    assert (price.factor, price.spread) == (pytest.approx(10**0.5), pytest.approx(0.0, abs=1e-6))
    assert price_of_a_digit(both, ("DOP853", "LSODA")).factor == pytest.approx(10**0.1)  # a slope, two lines
    assert price_of_a_digit(both, ("heyoka",)) is None
    useless = [within(NEED, "rk4", "step", 1.0, 0.5, cost=1e-9), within(NEED, "rk4", "step", 1e-9, 1e-12, cost=1e9)]
    assert price_of_a_digit([*both, *useless], ("rk4",)) == price  # neither lost from the start nor at rounding
    noisy = price_of_a_digit([reference, *ladder("rk4", 0.5, 1e-3, noise=(0.1, -0.1))], ("rk4",))
    assert abs(noisy.slope - 0.5) < noisy.spread < 1.0
    several = price_over_scenes({"a": both, "b": [reference, *ladder("rk4", 0.7, 1e-3)]}, ("rk4",))
    assert several.slope == pytest.approx(0.6)
    assert several.spread == pytest.approx(12.706 * 0.1, rel=1e-4)  # Student's, of two
    assert several.scenes == 2 and "over 2 related scenes) between errors of 1e-03 and 1e-06 m" in str(several)


def test_the_report_begins_with_the_price_of_a_digit(rows):
    told = prices_in_words({"damped": rows})
    assert told[0].startswith("`exact` has no setting, but one price, ") and "costs nothing" not in " ".join(told)
    assert any(text.startswith("One more digit of every position by `rk4` costs ") for text in told)
    off = next(row for row in rows if row.method == "baseline" and row.compared == NEED).position_error
    assert 1e-6 < off < 1e-2
    assert f"which is itself off by {off:.1e} m within 0.2 s" in baseline_in_words({"damped": rows})
    study = accuracy.Accuracy({}, QUICK)
    study.rows, study.growths = {"damped": rows}, {"damped": Growth(0.0, 0.1, False, 15.0)}
    page = accuracy_report.document(study, "")
    head = page.partition("Measured on")[0]
    assert "{" not in page and f"({accuracy_report.FOLDER}/accuracy.csv)" in page
    assert [line for line in head.splitlines() if line.startswith("- ")] == [f"- {text}" for text in told]


def speeds(*values):
    exact = Measurement("s", AVERAGE, "exact", "tolerance", 1e-9, 20.0, 16, mean_speed=-0.1, mean_speed_spread=0.001)
    return [exact, *(Measurement("s", AVERAGE, "rk4", "step", step, 20.0, 16, mean_speed=speed, mean_speed_spread=0.001,
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
    failed = [Measurement("s", NEED, "heyoka", "tolerance", 1e-9, SHORT, 0, note="not installed")]
    assert set(advice(failed, 15.0).values()) == {"nothing that was measured", "not measured"}

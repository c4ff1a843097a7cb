"""Text about measured rows: advice, slopes and findings."""

import pytest

from benchmark.report import digit_factor, speeds_table
from vibro_lab.accuracy.harness import AVERAGE, CANNOT, REFERENCE, REQUIRED, Row
from vibro_lab.accuracy.programs import PLAIN, TUNED
from vibro_lab.accuracy.report import (
    MEAN_SPEED,
    REQUIREMENTS,
    advice,
    cheapest,
    finding,
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


def within(compared, program, value, body, height=0.0, masses=0.0, cost=1.0, set_up=0.0):
    return Row("s", compared, program, TUNED, f"step {value:g} s", value, SHORT, 1, cost=cost, set_up=set_up,
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


def test_the_cheapest_of_a_short_run_is_the_one_with_little_set_up():
    """1 s/s and no set-up take 0.2 s over 0.2 s; 0.1 s/s and a set-up of 1 s take 1.02 s."""
    rows = [KNOWN, within(REQUIRED, "slow", 1e-5, 1e-6, cost=1.0), within(REQUIRED, "late", 1e-5, 1e-6, cost=0.1,
                                                                          set_up=1.0)]
    assert list(cheapest(rows, REQUIREMENTS[0])) == ["slow", "late"]


@pytest.mark.parametrize("column", range(3))
def test_every_position_is_that_of_body_height_and_masses(column):
    far = [2e-3 if k == column else 1e-5 for k in range(3)]
    rows = [KNOWN, measured_within(1e-4, *far), measured_within(1e-5, 1e-5, 1e-5, 1e-5)]
    assert rows[1].position_error == 2e-3
    assert cheapest(rows, REQUIREMENTS[0])["rk4"].value == 1e-5
    assert rows[1].path_error == (1e-5 if column == 2 else 2e-3)
    unknown = Row("s", REQUIRED, "rk4", TUNED, "", 1e-4, SHORT, 1, body_error=0.0, mass_error=0.0)
    assert not unknown.position_error < 1.0


def test_what_a_digit_costs_is_the_slope():
    assert digit_factor([(1e-3 / k, float(k)) for k in (1, 10, 100)]) == pytest.approx(10.0)  # first order
    assert not digit_factor([(1e-3, 1.0)]) > 0.0  # NaN: one setting
    assert not digit_factor([(1e-5, 1.0), (1e-4, 10.0), (1e-3, 100.0)]) > 0.0  # finer is worse: no digit is gained


def speeds(*values):
    exact = Row("s", AVERAGE, "exact", PLAIN, "", float("nan"), 20.0, 16, mean=-0.1, low=-0.101, high=-0.099)
    return [exact, *(Row("s", AVERAGE, "rk4", PLAIN, "", step, 20.0, 16, mean=speed, low=speed - 1e-3,
                         high=speed + 1e-3, starts_forwards=16 if speed > 0.0 else 0)
                     for step, speed in zip((1e-3, 1e-4, 1e-5), values, strict=True))]


def test_the_finding_names_the_steps_that_go_the_wrong_way():
    text = finding(speeds(0.05, -0.2, -0.101))
    assert "With a step of 0.001 s, `rk4` sends 16 of 16 starts the WRONG way, at 50.0 (49.0 to 51.0) mm/s." in text
    assert text.endswith("within 5% at 1e-05 s.")
    assert "At none of 3 steps" in finding(speeds(-0.2, -0.3, -0.2))
    assert "WRONG" not in finding(speeds(0.0005, -0.2, -0.101))  # 0 lies within the starts' range
    table = speeds_table(speeds(0.05, -0.2, -0.101))
    assert "| +50.0 (49.0 to 51.0) (!) | -200.0 (-201.0 to -199.0) | **-101.0 (-102.0 to -100.0)** |" in table


def test_what_failed_does_not_say_that_nothing_touches():
    failed = [LyapunovTime(0.0, 0.0, False, 15.0).row("s"),
              Row("s", REQUIRED, "heyoka", TUNED, "", 1e-9, SHORT, outcome=CANNOT, note="not installed")]
    assert set(advice(failed).values()) == {"nothing that was measured", "not measured"}

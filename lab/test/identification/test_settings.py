"""No setting of the fit sits on an edge: half and twice its value lead to the same verdict and values."""

from dataclasses import fields, replace

import pytest

from vibro_lab.identification.identify import identify
from vibro_lab.identification.settings import FitSettings

pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, is not installed")

from laboratory import Faults, record

FREE = ("ground.friction", "mass.body", "upper.gap", "inclined.spring.stiffness")
UNSEEN = {"unseen_loosenesses", "tied", "blur", "least_blurred", "unseen_weight", "rounds", "few_lost",
          "far_off_in_shares", "far_off", "scouts", "drawn", "better"}
"""Settings for masses that only an IMU feels."""
COARSE = {"draws", "drawn_widths", "coarse_loosenesses"}  # for samples that are too far apart for a speed
AT_MOST_ONE = {"better", "clearly", "most_lost", "few_lost"}  # shares: twice the value is 1 at most


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A recording with speeds and faults, one of positions at 100 Hz, and one of field sensors."""
    folder = tmp_path_factory.mktemp("bags")
    return {"fast": record(folder / "fast", "damped", seed=2, duration=1.5, faults=Faults(
                jitter=3e-4, late={"odom": 0.003}, outliers=0.02, lost=0.1, stated=0.33)),
            "coarse": record(folder / "coarse", "damped", seed=2, duration=2.0, faults=Faults(
                rate=100.0, positions_only=True)),
            "field": record(folder / "field", "damped", "field", seed=1, duration=1.5)}


def scaled(value, name, factor):
    if isinstance(value, tuple):
        return tuple(scaled(part, name, factor) for part in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    return min(value * factor, 1.0) if name in AT_MOST_ONE else value * factor


@pytest.mark.slow
@pytest.mark.settings
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("name", [field.name for field in fields(FitSettings)])
def test_half_and_twice_a_setting_lead_to_the_same_robot(bags, name, factor):
    settings = replace(FitSettings(), **{name: scaled(getattr(FitSettings(), name), name, factor)})
    made = bags["field" if name in UNSEEN else "coarse" if name in COARSE else "fast"]
    scene = made.truth.with_parameters({free: made.scene[free] for free in FREE})
    identified = identify(made.bag, scene, FREE, workers=1, settings=settings)
    assert identified.verdict.startswith("the model fits"), identified.verdict
    for free, (low, high) in identified.intervals.items():
        assert abs(identified.values[free] - made.truth[free]) < high - low, free

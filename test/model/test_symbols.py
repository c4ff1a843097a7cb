"""Forms as text in the paper's symbols."""

import math

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.description import Symbols, ratio
from vibro_ros.model.forms import Forms


def test_forms_are_written_as_the_paper_does():
    forms = Forms(vibro_ros.Scene("damped", {"upper.spring.damping": 2.0, "upper.plate.damping": 0.5}))
    write = Symbols(forms).text
    assert write(-forms.guide_force("upper", frozenset({"upper"}))) == (
        "-1000 (u - s_B) - 2 (u' - s_B') - 1e+07 (u - E) - 0.5 (u' - E')")
    assert write(forms.position(0) - 2.5 * forms.one) == "u - 2.5"
    assert write(forms.zero) == "0"


def test_the_ratio_of_two_forms_is_found_if_there_is_one():
    one, other = np.array([1.0, -3.0, 0.0]), np.array([1.0, -3.0, 1e-6])
    assert ratio(-0.2 * one, one) == pytest.approx(-0.2, rel=1e-15)
    assert ratio(other, one) is None
    assert ratio(0.0 * one, one) == 0.0
    assert math.isclose(ratio(one, one), 1.0)

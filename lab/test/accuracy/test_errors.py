"""Errors of answers: the distance of contacts in time, both ways."""

import numpy as np
import pytest

from vibro_lab.accuracy.harness import errors
from vibro_lab.accuracy.programs import COLUMNS, EVENT_DTYPE, Answer

TIMES = np.linspace(0.0, 1.0, 11)


def answer(instants):
    """Answer whose body stands and whose upper mass touches at `instants` [s]."""
    events = np.array([(instant, "upper_contact") for instant in instants], dtype=EVENT_DTYPE)
    return Answer(np.zeros((len(TIMES), len(COLUMNS))), events)


def distance(first, second):
    """Largest distance [s] from an instant of one array to the nearest instant of the other, by brute force.

    A contact without a counterpart counts with its distance from the nearest contact, whichever answer has it.
    """
    return max(max(min(abs(x - y) for y in second) for x in first), max(min(abs(x - y) for x in first) for y in second))


@pytest.mark.parametrize("sizes", [(1, 1), (5, 5), (40, 37), (3, 200)])
def test_contacts_are_apart_by_the_hausdorff_distance(sizes):
    draw = np.random.default_rng(sizes)
    first, second = (np.sort(draw.uniform(0.01, 1.0, size)) for size in sizes)
    assert errors(answer(first), answer(second), 1.0).events == distance(first, second)


def test_contacts_of_the_beginning_do_not_count():
    assert errors(answer([1e-4, 0.2]), answer([0.2]), 1.0).events == 0.0


def test_without_contacts_there_is_nothing_to_compare():
    assert np.isnan(errors(answer([]), answer([0.2]), 1.0).events)

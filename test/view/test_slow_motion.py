"""Slow motions are computed one after the other, and an error is reported to the page that made the request."""

import itertools
import threading
import time
import warnings

import numpy as np
import pytest

import vibro_ros
from vibro_ros.view import slow_motion
from vibro_ros.view.protocol import COLUMNS, MOST_SECONDS
from vibro_ros.view.slow_motion import MOST_WAITING, History, SlowMotions, motion_between

PATIENCE = 60.0  # [s] of what takes milliseconds
SCENE = vibro_ros.load_scene("device")
SAMPLES = {"time": np.array([0.0, 0.005])}


@pytest.fixture
def motions(monkeypatch):
    """Slow motions that call a test's function, by default one that returns its samples."""
    def prepared(compute) -> SlowMotions:
        monkeypatch.setattr(slow_motion, "motion_between", compute)
        return SlowMotions()
    return prepared


def until(done) -> None:
    deadline = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def answer(motions: SlowMotions, samples=SAMPLES) -> object:
    found: list[object] = []
    motions.ask(SCENE, samples, found.append)
    until(lambda: found)
    return found[0]


def test_what_goes_wrong_is_said_and_the_next_one_is_computed(motions):
    outcomes = iter([("first", b""), ZeroDivisionError("by chance"), ("third", b"")])

    def compute(scene, samples):
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    asked = motions(compute)
    assert answer(asked) == ("first", b"")
    assert answer(asked) == "there is no slow motion of these samples: ZeroDivisionError: by chance"
    assert answer(asked) == ("third", b"")
    assert answer(asked, {"time": np.array([1.0])}) == ("there are no samples of the last seconds; let the robot run")


def test_more_than_a_few_do_not_wait(motions):
    going_on = threading.Event()
    going_on.set()
    asked = motions(lambda scene, samples: going_on.wait(PATIENCE) and ("done", b""))
    going_on.clear()
    found: list[object] = []
    for _ in range(MOST_WAITING + 5):
        asked.ask(SCENE, SAMPLES, found.append)
    assert f"{MOST_WAITING} slow motions wait already; ask again later" in found
    going_on.set()
    until(lambda: len(found) == MOST_WAITING + 5)


def test_huge_numbers_in_the_samples_are_no_warning_on_the_terminal(motions, capfd):
    device = vibro_ros.Simulator(SCENE)
    rows = [device.values.copy() for tick in range(40) if not device.advance_to(tick / 200.0)]
    asked = motions(motion_between)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name, value in itertools.product(COLUMNS[1:], (-1.7e308, np.inf)):
            samples = dict(zip(COLUMNS, np.array(rows).T.copy(), strict=True))
            samples[name][[5, 9]] = value, -value
            header, _ = answer(asked, samples)
            assert header["end"] > header["begin"], name
    assert capfd.readouterr() == ("", "")


def test_the_history_is_of_the_last_seconds():
    history, rate = History(), 1000
    assert history.last() is None and history.samples(1.0)["time"].size == 0
    for batch in range(300):
        rows = np.zeros((rate // 10, len(COLUMNS)))
        rows[:, 0] = batch / 10.0 + np.arange(1, rate // 10 + 1) / rate
        history.add(rows)
    assert history.last()[0] == pytest.approx(30.0)
    times = history.samples(1.0)["time"]
    assert times[0] == pytest.approx(29.0) and len(times) == rate + 1
    assert MOST_SECONDS - 0.1 < np.ptp(history.samples(100.0)["time"]) < MOST_SECONDS + 0.2

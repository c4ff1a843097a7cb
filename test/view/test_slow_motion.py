"""Slow motions are computed one after the other, and what goes wrong with one is said to the page that asked."""

import threading
import time

import numpy as np
import pytest

import vibro_ros
from vibro_ros.view.frames import COLUMNS
from vibro_ros.view.history import History
from vibro_ros.view.requests import MOST_SECONDS
from vibro_ros.view.slow_motion import MOST_WAITING, SlowMotions

PATIENCE = 60.0  # [s] of what takes milliseconds once the kernels are there
SCENE = vibro_ros.load_scene("device")
SAMPLES = {"time": np.array([0.0, 0.005])}


def prepared(compute) -> SlowMotions:
    motions = SlowMotions(compute, lambda text: None)
    motions.prepare("exact")
    until(lambda: answer(motions) != "slow motion is being prepared; ask again in some seconds")
    return motions


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


def test_what_goes_wrong_is_said_and_the_next_one_is_computed():
    outcomes = iter([("first", b""), ZeroDivisionError("by chance"), ("third", b"")])

    def compute(scene, samples):
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    motions = prepared(compute)
    assert answer(motions) == "there is no slow motion of these samples: ZeroDivisionError: by chance"
    assert answer(motions) == ("third", b"")
    assert answer(motions, {"time": np.array([1.0])}) == ("there are no samples of the last seconds; let the robot run")


def test_before_the_first_robot_it_is_said_to_be_prepared():
    motions = SlowMotions(lambda scene, samples: ({}, b""), lambda text: None)
    assert answer(motions) == "slow motion is being prepared; ask again in some seconds"


def test_more_than_a_few_do_not_wait():
    going_on = threading.Event()
    going_on.set()

    def compute(scene, samples):
        going_on.wait(PATIENCE)
        return "done", b""

    motions = prepared(compute)
    going_on.clear()
    found: list[object] = []
    for _ in range(MOST_WAITING + 5):
        motions.ask(SCENE, SAMPLES, found.append)
    assert f"{MOST_WAITING} slow motions wait already; ask again later" in found
    going_on.set()
    until(lambda: len(found) == MOST_WAITING + 5)


@pytest.mark.parametrize("rate", [10, 200, 1000])
def test_the_history_is_of_the_last_seconds(rate):
    history = History()
    assert history.last() is None and history.samples(1.0)["time"].size == 0
    for batch in range(300):
        rows = np.zeros((rate // 10, len(COLUMNS)))
        rows[:, 0] = batch / 10.0 + np.arange(1, rate // 10 + 1) / rate
        history.add(rows)
    assert history.last()[0] == pytest.approx(30.0)
    times = history.samples(1.0)["time"]
    assert times[0] == pytest.approx(29.0) and len(times) == rate + 1
    assert MOST_SECONDS - 0.1 < np.ptp(history.samples(100.0)["time"]) < MOST_SECONDS + 0.2

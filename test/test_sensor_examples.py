"""The examples that use sensors give the results that they claim, compared with the true values."""

import importlib.util
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def example(name: str):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_estimator_knows_more_than_the_mean_and_an_integral_knows_nothing():
    estimator = example("estimator")
    weights = estimator.learned(range(8))
    estimated, integral, speeds = map(np.concatenate, zip(*(estimator.windows(seed) for seed in (100, 101, 102)),
                                                     strict=True))
    error, of_mean, of_integral = (np.sqrt(np.mean((told_speeds - speeds) ** 2))
                                   for told_speeds in (estimated @ weights, speeds.mean(), integral))
    assert error < 0.75 * of_mean and of_integral > 1.0


def test_the_controller_stays_at_the_target_between_the_ends_of_its_range():
    feedback = example("feedback")

    class Constant:
        def __init__(self, speed):
            self.speed = speed

        def motor_speed(self, now, measurements):
            return self.speed

    for seed in (0.0, 1.0, 2.0):
        errors, count = feedback.errors(feedback.Controller(), seed=seed)
        assert 150 < count < 290 and max(map(abs, errors[50:])) < 0.06  # of a way of 1.5 m
    ends = [feedback.errors(Constant(speed))[0][-1] for speed in (feedback.RESTING, feedback.FASTEST)]
    assert ends[0] > 0.3 and ends[1] < -0.3  # the target lies between what both ends of the range reach

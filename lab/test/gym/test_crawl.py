"""The environment: its checker, its seeds, its refusals, its reward and observations."""

import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env

from vibro_lab.gym import PERIOD, Crawl
from vibro_ros.configuration.scene_file import load_scene

NAME = "vibro_lab/Crawl-v1"


def environment_of(**arguments) -> gymnasium.Env:
    return gymnasium.make(NAME, **arguments)


def test_gymnasiums_checker_has_nothing_to_say():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment_of().unwrapped)


def test_the_seed_decides_all():
    env, random = environment_of(), np.random.default_rng(1)
    actions = random.uniform(-1.0, 1.0, (20, 3)).astype(np.float32)

    def episode(seed):
        observations = [env.reset(seed=seed)[0]]
        return np.array(observations + [env.step(action)[0] for action in actions])

    first, other = episode(4), episode(5)
    assert np.array_equal(episode(4), first) and not np.array_equal(first, other)
    assert not np.array_equal(env.reset()[0], env.reset()[0])  # of one seed, episodes differ
    assert env.reset(options={"target_speed": -0.05})[0][1] == np.float32(-0.5)


def test_several_at_once_are_what_each_is_alone():
    count, actions = 3, np.random.default_rng(2).uniform(-1.0, 1.0, (10, 3, 3)).astype(np.float32)
    vector = gymnasium.make_vec(NAME, num_envs=count, vectorization_mode="sync")
    together = [vector.reset(seed=7)[0], *(vector.step(action)[0] for action in actions)]
    for k in range(count):
        env = environment_of()
        alone = [env.reset(seed=7 + k)[0], *(env.step(action)[0] for action in actions[:, k])]
        assert np.array_equal(np.array(together)[:, k], np.array(alone))
    vector.close()


def test_the_truth_is_in_info_and_the_reward_is_of_it():
    env = environment_of(scene="damped")
    env.reset(seed=3, options={"target_speed": -0.04})
    for k in range(1, 30):
        observation, reward, *_, info = env.step(np.array([0.4, -1.0, -1.0], np.float32))
        ahead = info["body_position"] - info["target_position"]
        assert info["target_position"] == pytest.approx(-0.04 * k * PERIOD)
        assert reward == pytest.approx(-abs(ahead) / 0.1)
        assert observation[0] * 0.1 == pytest.approx(ahead, abs=5.0 * 0.001)
    assert abs(observation[2] - 1.05) < 0.05 and np.array_equal(observation[3:], np.float32([0.4, -1.0, -1.0]))


def test_a_hostile_action_is_one_of_the_space():
    env = environment_of().unwrapped
    env.reset(seed=0)
    assert np.array_equal(env.step(np.array([1e30, -np.inf, 5.0]))[0][3:], [1.0, -1.0, 1.0])
    for wrong in ([np.nan, 0.0, 0.0], [0.0, 0.0], 0.0, np.zeros((1, 3))):
        with pytest.raises(ValueError, match="^action: .* is not three numbers; give motor speed, upper gap and incli"):
            env.step(np.array(wrong))


@pytest.mark.parametrize(("scene", "changes", "reason"), [
    ("device", {"motor.max_speed": 100.0}, "motor.speed: 150 is out of range; .*the limit is motor.max_speed"),
    ("machine", {"motor.control": "voltage"}, "motor_speed: 150.0 is no command of this motor; command motor_voltage"),
    ("damped", {"mass.upper_slider": 0.05}, "motor_speed: 150 rad/s would be reached at once by effects.motor 'ideal'"),
])
def test_a_robot_that_cannot_perform_an_action_is_refused_when_it_is_made(scene, changes, reason):
    with pytest.raises(ValueError, match=f"^scene {scene}: cannot perform the largest action, .* because {reason}"):
        environment_of(scene=load_scene(scene).with_parameters(changes))


def test_an_environment_with_every_sensor_goes_on_as_its_pickled_copy_does():
    scene = load_scene("machine").with_parameters({"sensors.preset": "bmi270", "sensors.imu.rate": 100.0,
                                                   "sensors.current.rate": 100.0})
    env = environment_of(scene=scene)
    env.reset(seed=2)
    action = np.array([0.4, -1.0, 0.3], np.float32)
    env.step(action)
    copied = pickle.loads(pickle.dumps(env))
    for _ in range(20):  # beyond a block of random numbers
        (seen, *_), (seen_by_copy, *_) = env.step(action), copied.step(action)
        assert np.array_equal(seen, seen_by_copy)
        measured, measured_by_copy = env.unwrapped._measured, copied.unwrapped._measured
        assert all(np.array_equal(measured[name], measured_by_copy[name]) for name in measured)
    assert {"imu", "current"} <= measured.keys() == measured_by_copy.keys()


def test_a_step_before_the_first_reset_is_refused():
    with pytest.raises(ResetNeeded, match="step: no episode has begun; call reset"):
        environment_of().unwrapped.step(np.zeros(3))


def test_a_picture_has_robot_and_target():
    env = environment_of(render_mode="rgb_array")
    env.reset(seed=0, options={"target_speed": -0.05})
    action = np.array([0.4, -1.0, -1.0], np.float32)
    steps = [env.step(action) for _ in range(10)]
    picture, info = env.render(), steps[-1][-1]
    assert picture.shape == (160, 480, 3) and picture.dtype == np.uint8
    blue, red = ((picture[60:120].astype(int) @ weights > 100).any(axis=0).nonzero()[0]
                 for weights in ([-1, 0, 1], [1, -1, 0]))
    metres = 1.2 / (0.96 * 480)  # of a column
    ahead = (info["body_position"] - info["target_position"]) / metres
    assert blue.mean() - red.mean() == pytest.approx(ahead, abs=2.0)
    with pytest.raises(ValueError, match="render_mode: 'human' is not offered"):
        Crawl(render_mode="human")


def test_another_observation_has_the_measurements_of_every_sensor():
    measurements = []

    def acceleration(measured):
        measurements.append(dict(measured))
        return np.float32(measured["imu"][:3] / 100.0)

    scene = load_scene("device").with_parameters({"sensors.imu.rate": 100.0})
    space = Box(-1e3, 1e3, (3,), np.float32)
    env = environment_of(scene=scene, observation=acceleration, observation_space=space)
    env.reset(seed=0, options={"target_speed": -0.05})
    for _ in range(5):
        observation, *_, info = env.step(np.array([0.4, -1.0, -1.0], np.float32))
    last = measurements[-1]
    assert env.observation_space == space and np.array_equal(observation, np.float32(last["imu"][:3] / 100.0))
    assert last.keys() == {"ahead", "target_speed", "crank_speed", "action", "encoder", "tracking", "imu"}
    assert last["target_speed"] == -0.05 and abs(last["crank_speed"] - 105.0) < 5.0
    assert last["ahead"] == pytest.approx(info["body_position"] - info["target_position"], abs=5.0 * 0.001)
    assert np.array_equal(last["action"], np.float32([0.4, -1.0, -1.0]))
    with pytest.raises(ValueError, match="observation, observation_space: give both, or none"):
        Crawl(observation=acceleration)

"""Steps of a live robot by simulation_interfaces: as many as were asked for, and however many, nobody is held up."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from observation import stamps_of
from rosbags.rosbag2 import Reader
from simulator_user import MOST, ended

from vibro_ros.bag.cdr import deserialised
from vibro_ros.ros.robot.simulation_rules import Code, State

STEPS = 12


def test_steps_are_samples_and_only_a_paused_robot_takes_them(simulator, tmp_path):
    code, words = simulator.call("StepSimulation", steps=5)
    assert (code, words) == (Code.OPERATION_FAILED, "the robot is not paused; set the state 2 (PAUSED) first")
    status, code, words = simulator.result(simulator.send(5))
    assert (status, code) == (6, Code.OPERATION_FAILED) and "not paused" in words  # 6: aborted
    assert simulator.become(State.STOPPED) == Code.OK
    assert simulator.call("StepSimulation", steps=7) == (Code.OK, "")
    assert simulator.call("StepSimulation", steps=0) == (Code.OPERATION_FAILED, "0 steps; give at least 1")
    assert simulator.become(State.PLAYING) == Code.OK
    simulator.robot.send(signal.SIGINT)
    bag = tmp_path / ended(simulator.robot)
    (stepped, _), (resumed, words) = operations(bag)[-2:]
    assert words == "resume"
    assert len([stamp for stamp in stamps_of(bag) if stepped < stamp <= resumed]) == 7


def operations(bag: Path) -> list[tuple[int, str]]:
    """Stamp and words of what was done to the robot."""
    with Reader(bag) as reader:
        chosen = [one for one in reader.connections if one.topic == "/vibro_robot/operations"]
        return [(stamp, deserialised(bytes(data), one.msgtype).data) for one, stamp, data in reader.messages(chosen)]


def test_an_action_tells_of_each_step(simulator):
    simulator.become(State.PAUSED)
    goal = simulator.send(MOST)
    simulator.bench.spin_until(lambda: simulator.feedback, "feedback, once publisher and subscription have met")
    simulator.answer(goal.cancel_goal_async())
    simulator.result(goal)

    def told() -> list[tuple[int, int]]:
        return [one for one in simulator.feedback if sum(one) == STEPS]

    status, code, words = simulator.result(simulator.send(STEPS))
    assert (status, code, words) == (4, Code.OK, "")  # 4: succeeded
    simulator.bench.spin_until(lambda: len(told()) == STEPS, "feedback of every step")
    assert told() == [(done, STEPS - done) for done in range(1, STEPS + 1)]
    assert simulator.result(simulator.send(0))[1] == Code.OPERATION_FAILED


def test_endless_steps_hold_nobody_up_and_can_be_cancelled(simulator):
    simulator.become(State.PAUSED)
    goal = simulator.send(MOST)
    simulator.bench.spin_until(lambda: simulator.feedback, "steps")
    completed, remaining = simulator.feedback[-1]
    assert completed + remaining == MOST
    for name, fields in (("StepSimulation", {"steps": 1}), ("ResetSimulation", {"scope": 0})):
        code, words = simulator.call(name, **fields)
        assert code == Code.INCORRECT_STATE and f"{MOST} steps are being taken" in words
    assert simulator.result(simulator.send(3))[1] == Code.INCORRECT_STATE
    assert simulator.become(State.PAUSED) == Code.ALREADY_IN_TARGET_STATE
    assert len(simulator.answer(goal.cancel_goal_async()).goals_canceling) == 1
    status, code, words = simulator.result(goal)
    assert (status, code) == (5, Code.OPERATION_FAILED)  # 5: cancelled
    assert f" of {MOST} periods" in words
    assert simulator.state == State.PAUSED
    assert simulator.call("StepSimulation", steps=1) == (Code.OK, "")


@pytest.mark.parametrize("state", [State.PLAYING, State.STOPPED])
def test_another_state_ends_the_steps(simulator, listener, state):
    simulator.become(State.PAUSED)
    future = simulator.begin_endless_steps(listener)
    assert simulator.become(state) == Code.OK
    result = simulator.answer(future).result
    assert result.result == Code.OPERATION_FAILED and f" of {MOST} periods" in result.error_message
    assert simulator.state == state


@pytest.mark.parametrize("how", ["SIGINT", "QUITTING"])
def test_a_robot_that_ends_answers_who_waits_and_leaves_a_bag_that_replays(simulator, listener, tmp_path, how):
    simulator.become(State.PAUSED)
    simulator.call("StepSimulation", steps=50)
    simulator.become(State.STOPPED)
    future = simulator.begin_endless_steps(listener)
    if how == "SIGINT":
        simulator.robot.send(signal.SIGINT)
    else:
        assert simulator.become(State.QUITTING) == Code.OK
    result = simulator.answer(future).result
    assert (result.result, result.error_message) == (Code.OPERATION_FAILED, "the simulation has ended")
    bag = ended(simulator.robot)
    replay = [sys.executable, "-m", "vibro_ros.recordings.replay", str(bag)]
    done = subprocess.run(replay, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_requests_that_come_together_are_answered_one_by_one(simulator):
    codes, together = set(), 8  # DDS keeps the last 10 requests of a service that nobody has taken yet
    for first in range(0, 32, together):
        futures = [simulator.begin(name, **fields) for number in range(first, first + together) for name, fields in (
            ("StepSimulation", {"steps": number * 2**50}), ("ResetSimulation", {"scope": number}),
            ("GetSimulationState", {}))]
        while not all(future.done() for future in futures):
            simulator.become(State.PLAYING)
            simulator.become(State.STOPPED)  # which ends steps
        codes |= {future.result().result.result for future in futures}
    assert codes <= set(Code) and {Code.OK, Code.NOT_FOUND, Code.OPERATION_FAILED} <= codes
    simulator.robot.send(signal.SIGTERM)
    ended(simulator.robot)

"""A live robot as a simulator, for a program that knows simulation_interfaces and nothing of this robot."""

import time
from types import SimpleNamespace

import pytest
from observation import stamps_of, stop_with_whole_bag, whole_bag
from simulator_user import MOST_STEPS, Code, State
from std_srvs.srv import SetBool, Trigger
from test_operations import operations_in

from vibro_ros.recordings import replay
from vibro_ros.ros.node.node import GuardedNode
from vibro_ros.ros.robot.simulation_services import FEEDBACK_PERIOD

STEPS = 12


def test_features_states_steps_and_resets_are_as_the_definitions_say(simulator, call, listener, tmp_path):
    features = simulator.answer(simulator.begin("GetSimulatorFeatures")).features
    assert list(features.features) == [8, 10, 11, 12, 20, 22, 24, 25, 26, 31, 32, 33]
    assert list(features.spawn_formats) == []
    assert "publish period" in features.custom_info
    assert simulator.state == State.PLAYING
    for wanted, code, state in (
            (State.PLAYING, Code.ALREADY_IN_TARGET_STATE, State.PLAYING), (State.PAUSED, Code.OK, State.PAUSED),
            (State.PAUSED, Code.ALREADY_IN_TARGET_STATE, State.PAUSED), (State.STOPPED, Code.OK, State.STOPPED),
            (State.PAUSED, Code.INCORRECT_TRANSITION, State.STOPPED)):
        assert simulator.become(wanted) == code
        assert simulator.state == state
    assert simulator.call("StepSimulation", steps=1) == (Code.OK, "")
    assert simulator.state == State.PAUSED
    assert simulator.become(State.LOADING_WORLD) == Code.FEATURE_UNSUPPORTED
    assert simulator.become(255) == Code.NOT_FOUND
    assert simulator.become(State.PLAYING) == Code.OK
    # the services of std_srvs lead to the same states
    assert call(SetBool, "pause", data=True).success
    assert simulator.state == State.PAUSED
    assert call(Trigger, "reset").success
    assert simulator.state == State.STOPPED
    # a reset puts the state back and lets the clock go on
    assert simulator.become(State.PLAYING) == Code.OK
    listener.spin_for_samples(20)
    assert simulator.call("ResetSimulation", scope=2) == (Code.OK, "")
    assert simulator.state == State.PLAYING
    assert simulator.become(State.PAUSED) == Code.OK
    for scope in (0, 2, 255):
        simulator.call("StepSimulation", steps=3)
        assert simulator.state == State.PAUSED
        assert simulator.call("ResetSimulation", scope=scope) == (Code.OK, "")
        assert simulator.state == State.STOPPED
    for scope, code in ((1, Code.FEATURE_UNSUPPORTED), (4, Code.FEATURE_UNSUPPORTED), (8, Code.NOT_FOUND)):
        simulator.call("StepSimulation", steps=1)
        assert simulator.call("ResetSimulation", scope=scope)[0] == code
        assert simulator.state == State.PAUSED
    assert all(earlier < later for earlier, later in zip(listener.stamps, listener.stamps[1:], strict=False))
    # steps are samples, and only a paused robot takes them
    assert simulator.become(State.PLAYING) == Code.OK
    code, words = simulator.call("StepSimulation", steps=5)
    assert (code, words) == (Code.OPERATION_FAILED, "the robot is not paused; set the state 2 (PAUSED) first")
    status, code, words = simulator.result(simulator.send(5))
    assert (status, code) == (6, Code.OPERATION_FAILED) and "not paused" in words  # 6: aborted
    assert simulator.become(State.STOPPED) == Code.OK
    assert simulator.call("StepSimulation", steps=7) == (Code.OK, "")
    for steps in (0, 10**12):
        code, words = simulator.call("StepSimulation", steps=steps)
        assert code == Code.OPERATION_FAILED and words.startswith(f"{steps} steps; give 1 to {MOST_STEPS}")
        assert simulator.result(simulator.send(steps))[1:] == (Code.OPERATION_FAILED, words)
    assert simulator.become(State.PLAYING) == Code.OK
    bag = tmp_path / stop_with_whole_bag(simulator.robot)
    *_, stepped, resumed = stamps_of(bag, "/vibro_robot/operations")
    assert operations_in(bag)[-1] == "resume"
    assert len([stamp for stamp in stamps_of(bag) if stepped < stamp <= resumed]) == 7


def test_the_robot_is_the_only_entity_and_filters_apply(simulator, types, call):
    msg = types.msg
    robot, human = (msg.EntityCategory(category=number) for number in (
        msg.EntityCategory.CATEGORY_ROBOT, msg.EntityCategory.CATEGORY_HUMAN))
    for fields, names in (({}, ["vibro_robot"]), ({"filter": "^vibro_[a-z]+$"}, ["vibro_robot"]),
                          ({"filter": "arm"}, []), ({"categories": [human, robot]}, ["vibro_robot"]),
                          ({"categories": [human]}, []), ({"tags": msg.TagsFilter(tags=["red"])}, [])):
        filters = msg.EntityFilters(**fields)
        assert list(call(types.srv.GetEntities, "get_entities", filters=filters).entities) == names
        answer = call(types.srv.GetEntitiesStates, "get_entities_states", filters=filters)
        assert list(answer.entities) == names and len(answer.states) == len(names)
        assert all(state.header.frame_id == "odom" for state in answer.states)
    for fields, code, words in (
            ({"filter": "(a*)*b"}, Code.FEATURE_UNSUPPORTED, "'(a*)*b' could take long; give at most 64 characters"),
            ({"filter": "x*" * 5}, Code.FEATURE_UNSUPPORTED, "with 4 quantifiers and no group"),
            ({"filter": "["}, Code.OPERATION_FAILED, "'[' is no regular expression"),
            ({"bounds": msg.Bounds(type=msg.Bounds.TYPE_SPHERE)}, Code.FEATURE_UNSUPPORTED, "bounds: this robot has")):
        result = call(types.srv.GetEntities, "get_entities", filters=msg.EntityFilters(**fields)).result
        assert result.result == code and words in result.error_message
    answer = call(types.srv.GetEntityInfo, "get_entity_info", entity="vibro_robot")
    assert (answer.result.result, answer.info.category) == (Code.OK, robot) and "device" in answer.info.description
    assert call(types.srv.GetEntityInfo, "get_entity_info", entity="arm").result.result == Code.NOT_FOUND


def test_many_steps_give_feedback_block_no_service_and_can_be_cancelled(
        simulator, listener, tmp_path):
    simulator.become(State.PAUSED)
    begun = time.monotonic()
    goal = simulator.send(MOST_STEPS)
    simulator.bench.spin_until(lambda: len(simulator.feedback) > 2, "feedback")
    assert time.monotonic() - begun >= FEEDBACK_PERIOD * 2  # seldom: each costs a message
    assert all(sum(steps) == MOST_STEPS for steps in simulator.feedback)
    completed = [done for done, _ in simulator.feedback]
    assert completed == sorted(completed)
    for name, fields in (("StepSimulation", {"steps": 1}), ("ResetSimulation", {"scope": 0})):
        code, words = simulator.call(name, **fields)
        assert code == Code.INCORRECT_STATE and f"{MOST_STEPS} steps are being taken" in words
    assert simulator.result(simulator.send(3))[1] == Code.INCORRECT_STATE
    assert simulator.become(State.PAUSED) == Code.ALREADY_IN_TARGET_STATE
    assert len(simulator.answer(goal.cancel_goal_async()).goals_canceling) == 1
    status, code, words = simulator.result(goal)
    assert (status, code) == (5, Code.OPERATION_FAILED)  # 5: cancelled
    assert f" of {MOST_STEPS} periods" in words
    assert simulator.state == State.PAUSED
    status, code, words = simulator.result(simulator.send(STEPS))
    assert (status, code, words) == (4, Code.OK, "")  # 4: succeeded
    simulator.bench.spin_until(lambda: simulator.feedback[-1] == (STEPS, 0), "feedback of the last step")
    # another state ends the steps
    for state in (State.PLAYING, State.STOPPED):
        simulator.become(State.PAUSED)
        future = simulator.begin_many_steps(listener)
        assert simulator.become(state) == Code.OK
        result = simulator.answer(future).result
        assert result.result == Code.OPERATION_FAILED and f" of {MOST_STEPS} periods" in result.error_message
        assert simulator.state == state
    codes, together = set(), 8  # DDS keeps the last 10 requests of a service that nobody has taken yet
    for first in range(0, 32, together):
        futures = [simulator.begin(name, **fields) for number in range(first, first + together) for name, fields in (
            ("StepSimulation", {"steps": number * 2**12}), ("ResetSimulation", {"scope": number}),
            ("GetSimulationState", {}))]
        while not all(future.done() for future in futures):
            simulator.become(State.PLAYING)
            simulator.become(State.STOPPED)  # which ends steps
        codes |= {future.result().result.result for future in futures}
    assert codes <= set(Code) and {Code.OK, Code.NOT_FOUND, Code.OPERATION_FAILED} <= codes
    future = simulator.begin_many_steps(listener)
    assert simulator.become(State.QUITTING) == Code.OK
    result = simulator.answer(future).result
    assert (result.result, result.error_message) == (Code.OPERATION_FAILED, "the simulation has ended")
    assert replay.main([str(tmp_path / whole_bag(simulator.robot))]) == 0


def test_a_request_whose_callback_fails_is_answered(types):
    async def fail(request, response):
        raise KeyError("nobody foresaw it")

    caught: list[str] = []
    node = SimpleNamespace(refusals=SimpleNamespace(catch=lambda name, error: caught.append(name)))
    kind = types.srv.StepSimulation
    answering = GuardedNode._answer(node, "/step", fail, kind.Request(), kind.Response())
    with pytest.raises(StopIteration) as end:
        answering.send(None)
    result = end.value.value.result
    assert (result.result, result.error_message) == (Code.OPERATION_FAILED, "KeyError; the node's log says more")
    assert caught == ["/step"]

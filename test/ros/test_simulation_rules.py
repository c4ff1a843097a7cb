"""What requests of simulation_interfaces mean, and what programs are told when they cannot be done."""

from types import SimpleNamespace

import pytest

from vibro_ros.messages.operations import PAUSE, RESET, RESUME, Operation
from vibro_ros.ros.robot.operations import Request
from vibro_ros.ros.robot.services import (
    FEATURES,
    MOST_STEPS,
    TRANSITIONS,
    Code,
    Feature,
    RefusalError,
    Scope,
    SimulationControl,
    State,
    check_scope,
    check_steps,
    current_state,
    transition,
)

BYTE = range(256)
REFUSED = {  # by current and wanted state
    **{(state, state): Code.ALREADY_IN_TARGET_STATE for state in TRANSITIONS},
    **{(state, other): Code.FEATURE_UNSUPPORTED for state in TRANSITIONS
       for other in (State.NO_WORLD, State.LOADING_WORLD)},
    **{(state, number): Code.NOT_FOUND for state in TRANSITIONS for number in BYTE[6:]},
    **{(State.QUITTING, other): Code.INCORRECT_TRANSITION for other in BYTE[:3]},
    (State.STOPPED, State.PAUSED): Code.INCORRECT_TRANSITION,
}
DONE = {
    (State.STOPPED, State.PLAYING): (RESUME,),
    (State.PLAYING, State.STOPPED): (PAUSE, RESET),
    (State.PLAYING, State.PAUSED): (PAUSE,),
    (State.PAUSED, State.STOPPED): (RESET,),
    (State.PAUSED, State.PLAYING): (RESUME,),
    **{(state, State.QUITTING): () for state in (State.STOPPED, State.PLAYING, State.PAUSED)},
}


@pytest.fixture(scope="module")
def interfaces():
    """The messages and services of simulation_interfaces; where there is no compiler they are not installed."""
    return pytest.importorskip("simulation_interfaces.msg"), pytest.importorskip("simulation_interfaces.srv")


def test_the_numbers_are_those_of_the_definitions(interfaces):
    messages, services = interfaces
    codes, more = messages.Result, services.SetSimulationState.Response
    assert {code.name: code.value for code in Code} == {
        **{name.removeprefix("RESULT_"): getattr(codes, name) for name in (
            "RESULT_FEATURE_UNSUPPORTED", "RESULT_OK", "RESULT_NOT_FOUND", "RESULT_INCORRECT_STATE",
            "RESULT_OPERATION_FAILED")},
        **{name: getattr(more, name) for name in (
            "ALREADY_IN_TARGET_STATE", "STATE_TRANSITION_ERROR", "INCORRECT_TRANSITION")}}
    for state in State:
        assert getattr(messages.SimulationState, f"STATE_{state.name}") == state
    for name, scope in Scope.__members__.items():
        assert getattr(services.ResetSimulation.Request, f"SCOPE_{name}") == scope
    for feature in Feature:
        assert getattr(messages.SimulatorFeatures, feature.name) == feature
    assert {feature for features in FEATURES.values() for feature in features} == set(Feature)


@pytest.mark.parametrize("current", TRANSITIONS)
def test_every_number_of_a_state_has_an_answer(current):
    for wanted in BYTE:
        if (current, wanted) in DONE:
            assert transition(current, wanted) == DONE[current, wanted]
            continue
        with pytest.raises(RefusalError) as refused:
            transition(current, wanted)
        assert refused.value.code == REFUSED[current, wanted], wanted
        assert str(wanted) in str(refused.value) or State(wanted).name in str(refused.value)


def test_only_the_state_can_be_reset_and_nothing_by_halves():
    answers = {}
    for scope in BYTE:
        try:
            check_scope(scope)
            answers[scope] = Code.OK
        except RefusalError as refused:
            answers[scope] = refused.code
            assert str(refused).startswith(f"scope {scope}: ")
    assert {scope for scope, code in answers.items() if code == Code.OK} == {Scope.DEFAULT, Scope.STATE, Scope.ALL}
    assert {scope for scope, code in answers.items() if code == Code.FEATURE_UNSUPPORTED} == {1, 3, 4, 5, 6, 7}
    assert {scope for scope, code in answers.items() if code == Code.NOT_FOUND} == set(BYTE[8:255])


@pytest.mark.parametrize("steps", [0, MOST_STEPS + 1, 2**64 - 1])
def test_too_few_and_too_many_steps_are_refused(steps):
    """A goal of 10^12 steps wrote a gigabyte in five minutes."""
    with pytest.raises(RefusalError, match=f"^{steps} steps; give 1 to {MOST_STEPS}, and ask again") as refused:
        check_steps(steps)
    assert refused.value.code == Code.OPERATION_FAILED
    check_steps(1)
    check_steps(MOST_STEPS)


@pytest.mark.parametrize(("paused", "at_start", "quitting", "state"), [
    (False, False, False, State.PLAYING), (False, True, False, State.PLAYING), (True, True, False, State.STOPPED),
    (True, False, False, State.PAUSED), (True, False, True, State.QUITTING), (False, True, True, State.QUITTING)])
def test_the_state_follows_from_what_the_robot_does(paused, at_start, quitting, state):
    assert current_state(paused, at_start, quitting) == state


class FailingOperations:
    """Operations that are refused, or that the end of the run leaves undone."""

    def __init__(self, error: Exception, paused: bool):
        self.paused, self.error, self.asked = paused, error, []

    def ask(self, operation: Operation, counted=None) -> Request:
        self.asked.append(operation.name)
        request = Request(operation, counted)
        request.set_exception(self.error)
        return request


@pytest.fixture(params=[ValueError("100 operations wait already"), RuntimeError("the simulation has ended")], ids=str)
def error(request) -> Exception:
    return request.param


def control_of(operations: FailingOperations) -> SimulationControl:
    node = SimpleNamespace(executor=SimpleNamespace(wake=lambda: None))
    return SimulationControl(node, operations, SimpleNamespace(at_start=False))


def refusal_of(answering) -> RefusalError:
    """The refusal with which a coroutine ends that has nothing to wait for."""
    with pytest.raises(RefusalError) as refused:
        answering.send(None)
    return refused.value


def test_a_transition_that_fails_is_an_error_of_the_transition(error):
    operations = FailingOperations(error, paused=False)
    control = control_of(operations)
    refused = refusal_of(control.change_state(State.STOPPED))
    assert (refused.code, str(refused)) == (Code.STATE_TRANSITION_ERROR, str(error))
    assert operations.asked == ["pause", "reset"]  # together, so that nothing comes between them
    assert control.state == State.PLAYING and control.waiting == 0


def test_a_reset_and_steps_that_fail_are_failed_operations(error):
    control = control_of(FailingOperations(error, paused=True))
    assert refusal_of(control.reset(0)).code == Code.OPERATION_FAILED
    refused = refusal_of(control.finish_steps(control.begin_steps(3)))
    assert (refused.code, str(refused)) == (Code.OPERATION_FAILED, str(error))


def test_a_robot_that_is_about_to_end_does_nothing_more():
    operations = FailingOperations(RuntimeError("not asked"), paused=True)
    control = control_of(operations)
    with pytest.raises(StopIteration):
        control.change_state(State.QUITTING).send(None)
    assert control.quitting and control.state == State.QUITTING
    assert refusal_of(control.change_state(State.QUITTING)).code == Code.ALREADY_IN_TARGET_STATE
    assert refusal_of(control.change_state(State.PLAYING)).code == Code.INCORRECT_TRANSITION
    assert refusal_of(control.reset(0)).code == Code.INCORRECT_STATE
    with pytest.raises(RefusalError) as refused:
        control.begin_steps(1)
    assert refused.value.code == Code.INCORRECT_STATE
    assert operations.asked == []

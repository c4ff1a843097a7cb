"""What requests of simulation_interfaces mean: every state, scope and number of steps that a message can hold."""

import pytest

from vibro_ros.messages.topics import PAUSE, RESET, RESUME
from vibro_ros.ros.robot.simulation_rules import (
    FEATURES,
    MOST_STEPS,
    TRANSITIONS,
    Code,
    Feature,
    RefusalError,
    Scope,
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


def test_the_table_of_answers_is_whole():
    assert set(REFUSED) | set(DONE) == {(current, wanted) for current in TRANSITIONS for wanted in BYTE}
    assert not set(REFUSED) & set(DONE)


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

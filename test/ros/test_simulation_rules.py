"""What requests of simulation_interfaces mean, and what programs are told when they cannot be done."""

import pytest
from simulator_user import Code, State

from vibro_ros.messages.operations import PAUSE, RESET, RESUME

pytest.importorskip("simulation_interfaces.msg", reason="types of simulation_interfaces are not built: no compiler")

from vibro_ros.ros.robot.simulation_services import (
    MOST_STEPS,
    OFFERED,
    STATES,
    TRANSITIONS,
    RefusalError,
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


def test_states_and_features_are_those_of_the_definitions():
    assert STATES == {state.value: state.name for state in State if state.name in STATES.values()} and len(STATES) == 4
    assert sorted({feature for _, features in OFFERED.values() for feature in features}) == [
        10, 11, 20, 22, 24, 25, 26, 31, 32, 33]


@pytest.mark.parametrize("current", TRANSITIONS)
def test_every_number_of_a_state_has_an_answer(current):
    for wanted in BYTE:
        if (current, wanted) in DONE:
            assert transition(current, wanted) == DONE[current, wanted]
            continue
        with pytest.raises(RefusalError) as refused:
            transition(current, wanted)
        assert refused.value.code == REFUSED[current, wanted], wanted
        assert str(wanted) in str(refused.value) or STATES[wanted] in str(refused.value)


def test_only_the_state_can_be_reset_and_nothing_by_halves():
    answers = {}
    for scope in BYTE:
        try:
            check_scope(scope)
            answers[scope] = Code.OK
        except RefusalError as refused:
            answers[scope] = refused.code
            assert str(refused).startswith(f"scope {scope}: ")
    assert {scope for scope, code in answers.items() if code == Code.OK} == {0, 2, 255}
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

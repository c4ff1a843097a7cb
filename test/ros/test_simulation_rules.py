"""The meaning of requests of simulation_interfaces, and the results for requests that cannot be done."""

import pytest
from simulation_types import require_types
from simulator_user import Code, State

from vibro_ros.messages.operations import PAUSE, RESET, RESUME

require_types()
pytest.importorskip("simulation_interfaces.msg", reason="types of simulation_interfaces are not built: no compiler")

from vibro_ros.ros.robot.simulation_services import (  # noqa: E402  (needs the types)
    STATES,
    TRANSITIONS,
    RefusalError,
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


@pytest.mark.parametrize("current", TRANSITIONS)
def test_every_number_of_a_state_has_an_answer(current):
    for target in BYTE:
        if (current, target) in DONE:
            assert transition(current, target) == DONE[current, target]
            continue
        with pytest.raises(RefusalError) as refused:
            transition(current, target)
        assert refused.value.code == REFUSED[current, target], target
        assert str(target) in str(refused.value) or STATES[target] in str(refused.value)

"""What programs are told when the stepping thread cannot do what they ask; a real robot cannot be made to fail so."""

from types import SimpleNamespace

import pytest

from vibro_ros.messages.topics import Operation
from vibro_ros.ros.robot.operations import Request
from vibro_ros.ros.robot.services import SimulationControl
from vibro_ros.ros.robot.simulation_rules import Code, RefusalError, State


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

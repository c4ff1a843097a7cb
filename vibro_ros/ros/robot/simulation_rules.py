"""What a request of `simulation_interfaces` means for this robot, or why it is refused.

Pure functions of numbers: the services and the action ask them, and need not be installed for it. The numbers are those
of simulation_interfaces 2.1.0.
"""

from collections.abc import Iterable
from enum import IntEnum, IntFlag

from vibro_ros.messages.topics import PAUSE, RESET, RESUME

MOST_STEPS = 100_000
"""Steps that one request may ask for: about 8 minutes of robot time and 0.3 GB of a bag at the default rate."""


class Code(IntEnum):
    """How a request ended; those above 100 are of SetSimulationState alone."""

    FEATURE_UNSUPPORTED = 0
    OK = 1
    NOT_FOUND = 2
    INCORRECT_STATE = 3
    OPERATION_FAILED = 4
    ALREADY_IN_TARGET_STATE = 101
    STATE_TRANSITION_ERROR = 102
    INCORRECT_TRANSITION = 103


class State(IntEnum):
    """What the simulation is doing; `STOPPED` is paused at its start."""

    STOPPED = 0
    PLAYING = 1
    PAUSED = 2
    QUITTING = 3
    NO_WORLD = 4
    LOADING_WORLD = 5


class Scope(IntFlag):
    """What a reset puts back; 0 and `ALL` are everything."""

    DEFAULT = 0
    TIME = 1
    STATE = 2
    SPAWNED = 4
    ALL = 255


class Feature(IntEnum):
    """What a simulator can do, as far as this robot can."""

    SIMULATION_RESET = 20
    SIMULATION_RESET_STATE = 22
    SIMULATION_STATE_GETTING = 24
    SIMULATION_STATE_SETTING = 25
    SIMULATION_STATE_PAUSE = 26
    STEP_SIMULATION_SINGLE = 31
    STEP_SIMULATION_MULTIPLE = 32
    STEP_SIMULATION_ACTION = 33


FEATURES = {
    "GetSimulatorFeatures": (),
    "ResetSimulation": (Feature.SIMULATION_RESET, Feature.SIMULATION_RESET_STATE),
    "GetSimulationState": (Feature.SIMULATION_STATE_GETTING,),
    "SetSimulationState": (Feature.SIMULATION_STATE_SETTING, Feature.SIMULATION_STATE_PAUSE),
    "StepSimulation": (Feature.STEP_SIMULATION_SINGLE, Feature.STEP_SIMULATION_MULTIPLE),
    "SimulateSteps": (Feature.STEP_SIMULATION_MULTIPLE, Feature.STEP_SIMULATION_ACTION),
}
"""The features that each type of service or action brings."""

TRANSITIONS: dict[State, dict[State, tuple[str, ...]]] = {
    State.STOPPED: {State.PLAYING: (RESUME,), State.QUITTING: ()},
    State.PLAYING: {State.STOPPED: (PAUSE, RESET), State.PAUSED: (PAUSE,), State.QUITTING: ()},
    State.PAUSED: {State.STOPPED: (RESET,), State.PLAYING: (RESUME,), State.QUITTING: ()},
    State.QUITTING: {},
}
"""The operations that lead from a state to another. `STOPPED` to `PAUSED` is the definition's own example of an
incorrect transition: a stopped simulation stands still already."""


class RefusalError(Exception):
    """A request is refused.

    Parameters
    ----------
    code : Code
        Why, for programs.
    words : str
        Why, for people: the value, the limit and the remedy.
    """

    def __init__(self, code: Code, words: str):
        super().__init__(words)
        self.code = code


def current_state(paused: bool, at_start: bool, quitting: bool) -> State:
    """What a robot is doing."""
    if quitting:
        return State.QUITTING
    if not paused:
        return State.PLAYING
    return State.STOPPED if at_start else State.PAUSED


def transition(current: State, wanted: int) -> tuple[str, ...]:
    """The operations that lead from the current state to the one that is wanted.

    Raises
    ------
    RefusalError
        When the number is no state, when it is a state that this robot does not know, when the robot is in it already,
        or when nothing leads there.
    """
    if wanted not in list(State):
        raise RefusalError(Code.NOT_FOUND, f"{wanted} is no state; give one of {_listed(TRANSITIONS)}")
    target = State(wanted)
    if target not in TRANSITIONS:
        raise RefusalError(Code.FEATURE_UNSUPPORTED, f"{target.name}: this robot has no worlds to load; give one of "
                                                f"{_listed(TRANSITIONS)}")
    if target == current:
        raise RefusalError(Code.ALREADY_IN_TARGET_STATE, f"the robot is {current.name} already")
    if target not in TRANSITIONS[current]:
        reachable = _listed(TRANSITIONS[current]) or "none, because the robot is about to end"
        raise RefusalError(Code.INCORRECT_TRANSITION, f"nothing leads from {current.name} to {target.name}; from "
                                                 f"{current.name} these can be reached: {reachable}")
    return TRANSITIONS[current][target]


def check_scope(scope: int) -> None:
    """Refuse a reset of something that is not put back, so that nothing is put back by halves.

    Everything, which is `DEFAULT` or `ALL`, means everything that this robot can put back: its state.

    Raises
    ------
    RefusalError
        When the number has bits that are no scope, or asks by name for time or spawned entities.
    """
    if scope in (Scope.DEFAULT, Scope.ALL, Scope.STATE):
        return
    if unknown := scope & ~(Scope.TIME | Scope.STATE | Scope.SPAWNED):
        raise RefusalError(Code.NOT_FOUND, f"scope {scope}: {unknown} is no scope; give {_PUT_BACK}")
    if scope & Scope.TIME:
        raise RefusalError(Code.FEATURE_UNSUPPORTED, f"scope {scope}: robot time never runs back; give {_PUT_BACK}")
    raise RefusalError(Code.FEATURE_UNSUPPORTED, f"scope {scope}: this robot spawns nothing; give {_PUT_BACK}")


_PUT_BACK = "2 for the state, or 0 for all that can be put back"


def check_steps(steps: int) -> None:
    """Refuse a number of steps that is 0, or more than one request should take (RefusalError)."""
    if not 1 <= steps <= MOST_STEPS:
        raise RefusalError(Code.OPERATION_FAILED, f"{steps} steps; give 1 to {MOST_STEPS}, and ask again for more")


def _listed(states: Iterable[State]) -> str:
    return ", ".join(f"{state.value} ({state.name})" for state in states)

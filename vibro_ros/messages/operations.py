"""What is asked of a run besides commands, how a recording says it, and what it does to the device.

The robot publishes and records each operation that it performs as a text: the operation's name and, where it has any,
what belongs to it as JSON, such as ``step 10`` or ``set {"ground.friction": 0.1}``.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from vibro_ros.model.parameters import BY_NAME, Value
from vibro_ros.simulation.simulator import Simulator

RESET, PAUSE, RESUME, STEP, SET, TIMEOUT = "reset", "pause", "resume", "step", "set", "timeout"
NAMES = (RESET, PAUSE, RESUME, STEP, SET, TIMEOUT)


@dataclass(frozen=True)
class Operation:
    """One operation.

    Attributes
    ----------
    name : str
        `RESET`: back to the start. `PAUSE`, `RESUME`: robot time stands still, goes on. `STEP`: so many samples while
        robot time stands still. `SET`: other parameters. `TIMEOUT`: the motor stops, because no command came.
    steps : int
        Samples of `STEP`.
    parameters : mapping of str to value
        Of `SET`.
    """

    name: str
    steps: int = 0
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def __str__(self) -> str:
        rest = {STEP: str(self.steps), SET: json.dumps(dict(self.parameters))}.get(self.name)
        return self.name if rest is None else f"{self.name} {rest}"


def read_operation(text: str) -> Operation:
    """The operation that a recording tells.

    Raises
    ------
    ValueError
        When `text` tells none.
    """
    name, _, rest = text.partition(" ")
    try:
        if name not in NAMES or (name not in (STEP, SET) and rest):
            raise ValueError("no such operation")
        steps = int(rest) if name == STEP else 0
        parameters = json.loads(rest) if name == SET else {}
        if not isinstance(parameters, dict):
            raise ValueError("no mapping of parameters")
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{text[:60]!r} is no operation of the robot: {error}") from None
    return Operation(name, steps, parameters)


def perform(operation: Operation, device: Simulator) -> None:
    """Do to the device what the operation does to it; pauses and steps do nothing, because samples are counted.

    Raises
    ------
    ValueError
        For parameters that the device refuses; nothing is changed then.
    SimulationError
        When the run cannot go on.
    """
    if operation.name == RESET:
        device.reset()
    elif operation.name == TIMEOUT:
        device.command(motor_speed=0.0)
    elif of_scene := {name: value for name, value in operation.parameters.items() if name in BY_NAME}:
        device.set_parameters(of_scene)

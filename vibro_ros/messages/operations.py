"""Operations: the inputs of a run other than commands, such as a reset or a push, and their form as text.

The robot publishes and records each operation that it performs as a text: the operation's name and, if it has any, its
arguments as JSON, such as ``step 10`` or ``set {"ground.friction": 0.1}``.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from vibro_ros.model import faults
from vibro_ros.model.faults import FAULTS, Incident, checked_incident
from vibro_ros.model.parameters import BY_NAME, Value

if TYPE_CHECKING:  # readers of bags need no device
    from vibro_ros.simulation.simulator import Simulator

RESET, PAUSE, RESUME, STEP, SET, TIMEOUT = "reset", "pause", "resume", "step", "set", "timeout"
STATE, PUSH, FAULT = "state", "push", "fault"
ARGUMENTS: Mapping[str, frozenset[str]] = {
    SET: frozenset(), STATE: frozenset(), PUSH: frozenset(("duration", "force_x", "force_z")),
    FAULT: frozenset(Incident._fields)}
"""Operations with a mapping of arguments: the names that are required; empty where the device checks the names."""
NAMES = (RESET, PAUSE, RESUME, STEP, TIMEOUT, *ARGUMENTS)


@dataclass(frozen=True)
class Operation:
    """One operation."""

    # `RESET`: go back to the start, or into a state at time 0. `PAUSE`, `RESUME`: stop robot time, let it go on.
    # `STEP`: take some samples while paused. `SET`: change parameters. `TIMEOUT`: stop the motor, because no command
    # came in time. `STATE`: set the state (`Simulator.set_state`). `PUSH`: push the body (`Simulator.push`). `FAULT`:
    # begin or end a fault (`model.faults`)
    name: str
    steps: int = 0  # number of samples of a `STEP`
    parameters: Mapping[str, Value] = field(default_factory=dict)  # of an operation in `ARGUMENTS`; a `RESET`'s state

    def __str__(self) -> str:
        if self.name in ARGUMENTS or self.parameters:
            return f"{self.name} {json.dumps(dict(self.parameters))}"
        return f"{self.name} {self.steps}" if self.name == STEP else self.name


def read_operation(text: str) -> Operation:
    """Return the operation in a recorded text (ValueError when the text is no operation)."""
    name, _, rest = text.partition(" ")
    try:
        if name not in NAMES or (name not in (RESET, STEP, *ARGUMENTS) and rest):
            raise ValueError("no such operation")
        steps = int(rest) if name == STEP else 0
        parameters = json.loads(rest) if name in ARGUMENTS or (name == RESET and rest) else {}
        if not isinstance(parameters, dict):
            raise ValueError("no mapping of parameters")
        if (needed := ARGUMENTS.get(name)) and needed != set(parameters):
            raise ValueError(f"it needs {', '.join(sorted(needed))}")
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{text[:60]!r} is no operation of the robot: {error}") from None
    return Operation(name, steps, parameters)


def perform(operation: Operation, device: "Simulator") -> None:
    """Apply an operation to the device; pauses and steps do nothing to it, because robot time counts samples.

    ValueError when the device refuses the operation; nothing is changed then. SimulationError when the run cannot go
    on.
    """
    if operation.name == RESET:
        device.reset(**operation.parameters)
    elif operation.name == TIMEOUT:
        device.command(**{device.scene.motor_command: 0.0})
    elif operation.name == STATE:
        device.set_state(**operation.parameters)
    elif operation.name == PUSH:
        device.push(**operation.parameters)
    elif operation.name == FAULT:
        incident = checked_incident(**operation.parameters)
        if FAULTS[incident.fault].affects != faults.COMMANDS:  # commands are recorded when they take effect
            device.fail(*incident)
    elif of_scene := {name: value for name, value in operation.parameters.items() if name in BY_NAME}:
        device.set_parameters(of_scene)

"""Runs the simulator as a reference table says, for comparison with it."""

import numpy as np

import vibro_ros

POSITIONS = ("body_position", "upper_position", "inclined_position")
CONTACTS = ("upper_contact", "inclined_contact")


def replay(table: dict) -> tuple[list, np.ndarray]:
    """States at the table's times, and all events."""
    device = vibro_ros.Simulator(vibro_ros.load_scene("paper").with_parameters(table["parameters"]))
    commands = [(float(time), change) for time, change in table["commands"]]
    states, events = [], []
    for time in (float(text) for text in table["samples"]["time"]):
        while commands and commands[0][0] <= time:
            instant, change = commands.pop(0)
            device.advance_to(instant)
            device.command(**change)
        device.advance_to(time)
        states.append(device.state)
        events.append(device.take_events())
    return states, np.concatenate(events)


def column(table: dict, key: str) -> np.ndarray:
    """One quantity of the table, shape (n,)."""
    return np.array([float(text) for text in table["samples"][key]])


def reference_events(table: dict, kind: str) -> list[dict]:
    """The table's events of one kind, by time."""
    return sorted((entry for entry in table["events"] if entry["kind"] == kind),
                  key=lambda entry: float(entry["time"]))

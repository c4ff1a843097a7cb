"""Runs the simulator with the inputs of a reference table, and compares. As a program it prints the largest difference
of each position from every stored table.
"""

import json
from pathlib import Path

import numpy as np

import vibro_ros

FOLDER = Path(__file__).parent / "tables"
POSITIONS = ("body_position", "upper_position", "inclined_position")
CONTACTS = ("upper_contact", "inclined_contact")


def replay(table: dict) -> tuple[list, np.ndarray]:
    """Return states at the table's times, and all events."""
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


def errors(table: dict) -> dict[str, float]:
    """Largest difference of each position from the table [m]."""
    states, _ = replay(table)
    return {key: float(np.abs([getattr(state, key) for state in states] - column(table, key)).max())
            for key in POSITIONS}


if __name__ == "__main__":
    print(f"{'scene':<28}{'s':>5}{'body [m]':>11}{'upper [m]':>11}{'inclined [m]':>14}")
    for path in sorted(FOLDER.glob("*.json")):
        stored = json.loads(path.read_text())
        body, upper, inclined = errors(stored).values()
        print(f"{path.stem:<28}{float(stored['samples']['time'][-1]):>5.1f}{body:>11.1e}{upper:>11.1e}{inclined:>14.1e}")

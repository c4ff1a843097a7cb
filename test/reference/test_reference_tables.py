"""The simulation against stored 60-digit runs of an independent integrator (`generate.py`)."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from comparison import CONTACTS, POSITIONS, column, reference_events, replay

FOLDER = Path(__file__).parent
TABLES = {path.stem: json.loads(path.read_text()) for path in sorted((FOLDER / "tables").glob("*.json"))}
DAMPED = ("damped_adhesion", "damped_no_tension", "ramp_and_gaps", "reaction_weight_damped", "static_reaction_damped")


def tolerance(name):
    """Tolerance [m]: damped scenes forget rounding errors, loss-free ones amplify them (e⁵ a second)."""
    return 1e-10 if name in DAMPED else 1e-9


@pytest.fixture(scope="module")
def simulated():
    """Samples at the table's times and all events, by scene name; each scene runs once."""
    runs = {}

    def run(name):
        if name not in runs:
            runs[name] = replay(TABLES[name])
        return runs[name]

    return run


@pytest.mark.parametrize("name", TABLES)
def test_positions_agree_with_the_reference(name, simulated):
    """A39. Every hundredth of a second."""
    states, _ = simulated(name)
    for key in POSITIONS:
        error = np.abs([getattr(state, key) for state in states] - column(TABLES[name], key))
        assert error.max() <= tolerance(name), f"{key} off by {error.max():.1e} m at {error.argmax() / 100} s"


@pytest.mark.parametrize("name", TABLES)
def test_velocities_and_outputs_agree_with_the_reference(name, simulated):
    """A39. Speeds may be off by the position's tolerance times 1e4/s, the contact's angular frequency."""
    states, _ = simulated(name)
    speed = 1e4 * tolerance(name)
    limits = {"body_velocity": speed, "upper_velocity": speed, "inclined_velocity": speed, "motor_speed": 1e-12,
              "crank_angle": 1e-12,  # rad, of up to 100: its rounding is 1.4e-14
              "motor_power": 2e3 * speed}  # W: drive forces times slider speeds, 100 N and 10 m/s at most
    for key, limit in limits.items():
        error = np.abs([getattr(state, key) for state in states] - column(TABLES[name], key))
        assert error.max() <= limit, f"{key} off by {error.max():.1e} at {error.argmax() / 100} s"


@pytest.mark.parametrize("name", TABLES)
def test_ground_forces_agree_with_the_reference(name, simulated):
    """A39. Away from a contact, whose stiffness of 1e7 N/m would turn 1e-9 m into 1e-2 N."""
    states, _ = simulated(name)
    drive = 1e3 + 2e4  # N/m: springs, and dampers of 2 N·s/m times 1e4/s
    for key in ("normal_force", "friction_force"):
        reference = column(TABLES[name], key)
        for index, state in enumerate(states[1:], 1):
            if state.upper_plate_force == 0.0 and state.inclined_plate_force == 0.0:
                assert getattr(state, key) == pytest.approx(reference[index], abs=2 * drive * tolerance(name)), index


@pytest.mark.parametrize("name", TABLES)
def test_every_contact_of_the_reference_occurs_and_no_other(name, simulated):
    """A39. One contact for each of the reference, in the same order, with equal numbers."""
    _, events = simulated(name)
    for kind in CONTACTS:
        ours = np.sort(events[events["kind"] == kind], order="time")
        theirs = reference_events(TABLES[name], kind)
        assert len(ours) == len(theirs), kind
        for key, limit in (("time", 1e-8), ("duration", 1e-8), ("speed", 1e4 * tolerance(name))):
            expected = [float(entry[key]) for entry in theirs]
            np.testing.assert_allclose(ours[key], expected, rtol=1e-6, atol=limit, err_msg=f"{kind} {key}")
        np.testing.assert_allclose(ours["peak_force"], [float(entry["peak_force"]) for entry in theirs],
                                   rtol=1e-6, atol=2e7 * tolerance(name), err_msg=kind)


@pytest.mark.parametrize("kind", ["stick", "unloaded", "loaded"])
@pytest.mark.parametrize("name", TABLES)
def test_the_body_sticks_and_the_ground_is_unloaded_when_the_reference_says(name, kind, simulated):
    """A39. The changes are equally many, at the same instants."""
    if kind != "stick" and TABLES[name]["parameters"]["effects.normal_force"] != "unilateral":
        return
    _, events = simulated(name)
    times = np.sort(events["time"][events["kind"] == kind])
    expected = [float(entry["time"]) for entry in reference_events(TABLES[name], kind)]
    assert len(times) == len(expected)
    np.testing.assert_allclose(times, expected, rtol=0, atol=1e-7)


def test_the_documented_command_makes_the_stored_table(tmp_path):
    """The first 0.02 s of a table, letter for letter, start chatter of 171 events included."""
    pytest.importorskip("flint", reason="python-flint makes the tables")
    name = "loss_free_unilateral_rest"
    command = [sys.executable, FOLDER / "generate.py", "--scene", name, "--duration", "0.02", "--folder", tmp_path]
    subprocess.run(command, check=True, timeout=120)
    made, stored = json.loads((tmp_path / f"{name}.json").read_text()), TABLES[name]
    assert made["parameters"] == stored["parameters"]
    assert made["events"] == stored["events"][:len(made["events"])]
    for key, numbers in made["samples"].items():
        assert numbers == stored["samples"][key][:3], key


def test_the_reference_conserves_momentum_through_every_impact():
    """A29. On the table itself: M x' - m3 w' sin φ stays 0, here to the doubles' rounding."""
    table = TABLES["frictionless"]
    total = sum(table["parameters"][f"mass.{part}"] for part in ("body", "upper", "inclined"))
    share = table["parameters"]["mass.inclined"] * np.sin(table["parameters"]["guide.angle"])
    momentum = total * column(table, "body_velocity") - share * column(table, "inclined_velocity")
    assert np.abs(momentum).max() < 1e-15


@pytest.mark.parametrize("name", ["reaction", "reaction_printed_heavy", "static_reaction_damped"])
def test_the_reference_obeys_every_row_of_the_mass_matrix(name):
    """The mass matrix of docs/robot.md for y = 0, at instants of all modes; 64 digits times forces of up to 1e4 N."""
    pytest.importorskip("flint", reason="python-flint makes the tables")
    from flint import arb
    from generate import PAPER, SCENES

    from benchmark.reference_model import ReferenceModel

    model, modes = ReferenceModel(PAPER | SCENES[name][0]), set()
    heavy = arb(9.81) if model.values["effects.mass_weight"] else arb(0)
    for index in range(60):
        model.advance_to((arb(index) / 1000).mid())
        upper, inclined = model.guides
        x, u, w = model.velocity[1], 2 * upper.series[2], 2 * inclined.series[2]
        along, upwards = -inclined.mass * model.sine, inclined.mass * model.cosine
        rows = {"x": model.total_mass * x + along * w + model.friction_force[0],
                "y": upper.mass * u + upwards * w - model.normal[0] + model.weight,
                "u": upper.mass * u + upper.force[0] + upper.mass * heavy,
                "w": along * x + inclined.mass * w + inclined.force[0] + upwards * heavy}
        for row, rest in rows.items():
            assert abs(float(rest)) < 1e-55, (row, index)
        modes.add(model.body_mode)
    assert len(modes) > 2


def test_no_stored_run_is_missed_by_more_than_the_readme_says(simulated):
    text = " ".join((FOLDER.parents[1] / "README.md").read_text(encoding="utf-8").split())
    claimed = re.search(r"Against (\d+) stored runs .* no position is off by more than (\S+) m", text)
    assert len(TABLES) == int(claimed[1])
    assert max(np.abs([getattr(state, key) for state in simulated(name)[0]] - column(table, key)).max()
               for name, table in TABLES.items() for key in POSITIONS) <= float(claimed[2])

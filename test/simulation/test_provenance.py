"""A recording states everything that decides the bits of a run, and a replay names the differences."""

import pkgutil
import subprocess
import sys
from types import SimpleNamespace

import pytest

import vibro_ros
from vibro_ros.recordings.comparison import notes
from vibro_ros.recordings.rerun import RecordedRun
from vibro_ros.simulation import provenance

DEVICE = vibro_ros.load_scene("device")
ENTRIES = {"version", "platform", "sources"}


def differences(changes=None, without=()):
    """Return the notes on a bag that was recorded here, with `changes` of its statements."""
    told = {**provenance.provenance(DEVICE.parameters, 0), **(changes or {})}
    told = {key: value for key, value in told.items() if key not in without}
    topics = {name: f"/{name}" for name in ("motor_speed", "upper_gap", "inclined_gap")}
    stream = SimpleNamespace(metadata=told, start=0, topics=set(topics.values()), flaws=())
    return notes(stream, RecordedRun({}, DEVICE, 0, topics))


def test_provenance_has_every_entry_and_equals_itself():
    told = provenance.provenance(DEVICE.parameters, 0)
    assert ENTRIES | {"tables"} <= set(told) and all(told.values())
    assert differences() == []


@pytest.mark.parametrize("key", sorted(ENTRIES | {"tables"}))
def test_a_replay_names_the_entries_that_differ(key):
    (note,) = differences({key: "another"})
    assert note.startswith(f"recorded with {key.replace('_', ' ')} another, replayed with ")


def test_a_replay_of_an_older_bag_names_the_missing_entries():
    (note,) = differences(without={"sources", "tables"})
    assert note == ("the bag does not say its sources, tables: where they differ, "
                    "bits may")


def test_sources_differ_by_their_text_but_not_by_their_line_ends(monkeypatch):
    read, sources = pkgutil.get_data, provenance.software()["sources"]

    def told(change):
        monkeypatch.setattr(pkgutil, "get_data", lambda package, name: change(read(package, name), name))
        provenance.software.cache_clear()
        return provenance.software()["sources"]

    assert told(lambda text, name: text.replace(b"\n", b"\r\n")) == sources
    for module in ("flow.py", "noise.py"):  # of the solver, and of the sensors
        assert told(lambda text, name, module=module: text + b"#" * (name == module)) != sources
    monkeypatch.undo()
    provenance.software.cache_clear()
    assert provenance.software()["sources"] == sources


@pytest.mark.process
def test_sources_are_of_every_module_that_a_simulator_needs():
    code = "import sys, vibro_ros.simulation.simulator; print(*sys.modules)"
    needed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    room = "vibro_ros.simulation."
    modules = {name.removeprefix(room) for name in needed if name.startswith(room)}
    assert modules == {name for room, name in provenance._MODULES if room == "simulation"}


def test_provenance_has_the_seed():
    scene = DEVICE.with_parameters({"sensors.imu.rate": 200.0, "sensors.seed": 7.0})
    assert provenance.provenance(scene.parameters, 0)["seed"] == "7"


def test_tables_differ_with_the_scene_and_not_with_its_commands():
    tables = provenance.tables(DEVICE.parameters)
    assert provenance.tables(DEVICE.with_parameters({"motor.speed": 50.0}).parameters) == tables
    assert provenance.tables(DEVICE.with_parameters({"guide.angle": 1.0}).parameters) != tables

"""Command maps: what is written is read, what is not a map is refused, and commands are chosen where they are sure."""

import json
import os
import random
from dataclasses import fields, replace

import numpy as np
import pytest
from known_map import GAPS, SPEEDS, known_map, mean_speed

from vibro_ros.configuration.command_choice import FAR, CommandChoice
from vibro_ros.configuration.command_map import (
    LARGEST,
    SIDES,
    Found,
    parameters_that_count,
    read_map,
    written,
)
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.configuration.shipped import find_file, shipped


def commands(motor_speed, upper_gap, inclined_gap=None):
    return {"motor_speed": motor_speed, "upper_gap": upper_gap,
            "inclined_gap": upper_gap if inclined_gap is None else inclined_gap}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "known.json"
    path.write_text(written(known_map(), "a test"))
    return path


def refusal(path):
    with pytest.raises(ValueError, match=".") as caught:
        read_map(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 1000
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value).removeprefix(f"{path}: ")


def test_what_is_written_is_read(file):
    read, known = read_map(file), known_map()
    for name in (field.name for field in fields(Found)):
        np.testing.assert_allclose(getattr(read.found, name), getattr(known.found, name), rtol=1e-5, err_msg=name)
    assert replace(read, found=known.found) == known
    assert written(read, "a test") == file.read_text()


def test_the_shipped_maps_are_of_the_shipped_scenes_and_of_no_other_machine():
    assert "device" in shipped("map")
    for name in shipped("map"):
        path = find_file("map", name)
        assert path.stat().st_size <= LARGEST
        command_map = read_map(path)
        assert command_map.scene == name
        for scene in shipped_scenes():
            assert bool(command_map.difference(load_scene(scene))) == (scene != name)


def test_another_machine_is_told_by_its_first_parameter_and_other_commands_and_starts_are_not():
    scene, command_map = load_scene("device"), known_map()
    assert command_map.difference(scene.with_parameters({"mass.body": 1.25})) == "mass.body is 1 there, 1.25 here"
    assert not command_map.difference(scene.with_parameters({
        "motor.speed": 70.0, "upper.gap": 0.001, "inclined.gap": 0.002, "start.state": "zero",
        "motor.acceleration": 50.0, "solver.tolerance": 1e-6}))


def test_a_dc_motor_is_part_of_the_machine_but_for_its_commands(tmp_path):
    """A map of a machine with a given motor speed does not fit a machine with a dc motor, and the reverse."""
    device, machine = load_scene("device"), load_scene("machine")
    dc = device.with_parameters({"effects.motor": "dc"})
    assert known_map().difference(dc) == "effects.motor is given in time there, dc here"
    path = tmp_path / "machine.json"
    path.write_text(written(replace(known_map(), parameters=parameters_that_count(machine, SIDES)), "a test"))
    read = read_map(path)
    assert read.parameters == parameters_that_count(machine, SIDES)
    assert not read.difference(machine.with_parameters({"motor.speed": 90.0, "motor.acceleration": 50.0}))
    assert read.difference(machine.with_parameters({"motor.crank_inertia": 1e-3})) == (
        "motor.crank_inertia is 0.0005 there, 0.001 here")
    assert read.difference(machine.with_parameters({"effects.motor": "ramp"})) == "effects.motor is dc there, ramp here"


@pytest.mark.parametrize("place, motions", [
    (commands(10.0, 0.0), {0}), (commands(5.1, -0.0004), {0}), (commands(64.9, 0.002), {0, 1}),
    (commands(60.0, 0.001, 0.0014), {0, 1}),  # gaps that differ by less than half a cell
    (commands(4.9, 0.0), set()), (commands(60.0, 0.0046), set()), (commands(60.0, 0.001, 0.002), set()),
    (commands(float("nan"), 0.0), set())])
def test_motions_at_commands(place, motions):
    command_map = known_map()
    assert set(command_map.found.motion[command_map.rows_at(place)].tolist()) == motions


@pytest.mark.parametrize("speed", np.linspace(-0.0575, -0.0101, 4).tolist())
def test_commands_for_a_mean_speed_are_exact_where_the_map_is_linear(speed):
    chosen = CommandChoice(known_map()).commands_for(speed)
    motor, gap, other = chosen.commands.values()
    assert gap == other
    assert mean_speed(motor, gap) == pytest.approx(speed, abs=1e-7)
    assert motor <= 50.0  # at 60 rad/s there are two motions
    assert known_map().found.motion[chosen.row] == 0


def test_commands_keep_away_from_borders():
    """Of all cells with -30 mm/s the one in the middle of the motion is chosen, three cells from its borders."""
    chosen = CommandChoice(known_map()).commands_for(-0.03)
    assert chosen.clearance >= 2
    assert GAPS.low + GAPS.step <= chosen.commands["upper_gap"] <= GAPS.high - GAPS.step
    assert SPEEDS.low + SPEEDS.step <= chosen.commands["motor_speed"] <= 50.0 - SPEEDS.step
    wide = known_map()
    grid = np.array([(i, j) for i in range(12) for j in range(5)]).T
    one = np.ones(60, dtype=int)
    speeds = mean_speed(SPEEDS.values[grid[0]], GAPS.values[grid[1]])
    found = Found(*grid, 0 * one, one, one, one, speeds, *[np.zeros(60)] * 3)
    inner = CommandChoice(replace(wide, found=found))
    assert max(inner.commands_for(speed).clearance for speed in speeds[20:40]) == min(FAR, 3)


@pytest.mark.parametrize("speed, reason", [
    (0.05, "0.05 m/s is out of range of the map of device; give a mean speed from -0.108 to -0.01 m/s"),
    (-0.2, "-0.2 m/s is out of range of the map of device; give a mean speed from -0.108 to -0.01 m/s"),
    (0.0, "0 m/s is out of range of the map of device; give a mean speed from -0.108 to -0.01 m/s"),
    (-0.07, "no command of the map of device surely gives -0.07 m/s; the nearest that one gives are -0.09 and -0.058 "
     "m/s")])
def test_a_speed_that_nothing_surely_gives_is_refused_with_those_that_there_are(speed, reason):
    with pytest.raises(ValueError) as caught:
        CommandChoice(known_map()).commands_for(speed)
    assert str(caught.value) == reason


def test_a_map_without_a_sure_place_is_refused():
    command_map = known_map()
    found = replace(command_map.found, sure=np.zeros_like(command_map.found.sure))
    with pytest.raises(ValueError, match="no two neighbouring cells"):
        CommandChoice(replace(command_map, found=found))


@pytest.mark.parametrize("change, reason", [
    ({"type": "vibro_ros command map, version 2"}, "type: 'vibro_ros command map, version 2' is not"),
    ({"gaps": ["upper", "upper"]}, "gaps: "), ({"gaps": "upper"}, "gaps: 'upper' is no list of sides"),
    ({"motor_speed": {"from": 0.0, "to": 10.0, "count": 12}}, "motor_speed: from 0 rad/s; give speeds above 0"),
    ({"motor_speed": {"from": 20.0, "to": 10.0, "count": 12}}, "motor_speed: is no grid"),
    ({"gap": {"from": 0.0, "to": 1.0, "count": 10**9}}, "gap: is no grid"),
    ({"scene": "a\nb"}, "scene: is no text"),
    ({"more": 1}, "the document: 'more' is unknown"),
    ({"curves": [{}]}, "curves[0]: 'kind' is missing"),
    ({"parameters": {"ground.wind": 1.0}}, "ground.wind: unknown parameter"),
    ({"type": "x" * 300_000}, "type: "), ({"curves": 5}, "parameters, curves: give a mapping and a list"),
    ({"found": {"sure": [1]}}, "found: 'speed_index' is missing"),
])
def test_a_file_that_is_no_map_is_refused(file, change, reason):
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    assert refusal(file).startswith(f"no command map: {reason}")


@pytest.mark.parametrize("column, value", [
    ("speed_index", 12), ("gap_index", -1), ("sure", 2), ("motion", 10**20),
    ("mean_speed", None), ("mean_speed", 1e10)])
def test_a_row_that_cannot_be_is_refused(file, column, value):
    document = json.loads(file.read_text())
    document["found"][column][3] = value
    file.write_text(json.dumps(document))
    assert refusal(file).startswith(f"no command map: found.{column}: holds ")


@pytest.mark.parametrize("content", [
    b"", b"{", b"[]", b"null", b"\xff\xfe", b"[" * 100_000, b'{"type": NaN}', b'{"type": 1, "type": 2}', b"1" * 10_000,
    b'{"a": 1e999}', b"{" + b" " * LARGEST + b"}"], ids=lambda content: content[:20].hex())
def test_other_bytes_are_refused(tmp_path, content):
    path = tmp_path / "map.json"
    path.write_bytes(content)
    refusal(path)


def test_a_parameter_that_a_map_lacks_has_its_default_and_a_long_value_makes_no_long_message(file):
    """A map may have been made before the parameter existed."""
    document = json.loads(file.read_text())
    assert document["parameters"].pop("ground.stribeck_speed") == 0.01
    file.write_text(json.dumps(document))
    assert read_map(file).parameters["ground.stribeck_speed"] == 0.01
    document["parameters"]["effects.friction"] = "x" * 300_000
    file.write_text(json.dumps(document))
    assert "effects.friction: 'xxx" in refusal(file)


def test_a_file_with_a_damaged_character_is_a_map_or_refused(file):
    text, dice = file.read_text(), random.Random(18)
    for _ in range(300):
        at = dice.randrange(len(text))
        file.write_text(text[:at] + dice.choice('0123456789-"{}[],:.eEnul\x00') + text[at + dice.randrange(3):])
        try:
            read_map(file)
        except ValueError as error:
            assert "\n" not in str(error) and str(error).startswith(f"{file}: ")


def test_what_is_no_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path, tmp_path / "pipe.json", tmp_path / "none.json"):
        refusal(path)


@pytest.mark.parametrize("name", ["", "nowhere.json", "a\0b"])
def test_a_map_that_is_nowhere_is_named(name):
    with pytest.raises(ValueError, match="neither a shipped map nor a file; shipped maps are device, machine"):
        find_file("map", name)

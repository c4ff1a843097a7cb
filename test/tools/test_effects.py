"""The table of effects: counts, costs and speeds of pairs of scenes."""

from pathlib import Path

import numpy as np
import pytest

from tools import effects
from tools.effects import mean_speeds, measure, size
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.simulation.simulator import Simulator

DEVICE = load_scene("device")
EFFECTS = {effect.name: effect for effect in effects.EFFECTS}


def test_sizes_are_those_that_can_be_counted_by_hand():
    """Two masses, no plates, no friction, N = M g: u and w each fall to their own spring and slider, x follows w."""
    plain = DEVICE.with_parameters({
        "effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.friction": "none",
        "effects.normal_force": "weight", "effects.reaction": False, "effects.mass_weight": False,
        "upper.spring.damping": 0.0, "inclined.spring.damping": 0.0})
    assert size(plain) == effects.Size(states=6, modes=1, terms=2 + 2 + 1, guards=0)
    plate = plain.with_parameters({"effects.upper_contact": "compliant", "effects.adhesion": True})
    # In contact u'' reads u, u', the slider, the plate's place and its speed.
    assert size(plate) == effects.Size(states=6, modes=2, terms=5 + 2 + 1, guards=1)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_each_effect_changes_its_own_parameters_and_nothing_else(effect):
    with_it, without = effect.scenes()
    changed = {name for name in with_it.parameters if with_it[name] != without[name]}
    assert changed == set(effect.without)


def test_every_choice_of_every_effect_is_compared_in_a_row():
    """Of the parameters that choose an effect or a start: who adds a choice is told here to give it a row."""
    choosing = [parameter for parameter in SCENE_PARAMETERS if parameter.name.startswith("effects.")
                or parameter.name == "start.state"]
    compared = {parameter.name: {scene[parameter.name] for effect in effects.EFFECTS for scene in effect.scenes()
                                 if parameter.name in effect.without} for parameter in choosing}
    assert compared == {parameter.name: set(parameter.choices or (True, False)) for parameter in choosing}
    assert any(effect.travel for effect in effects.EFFECTS)


def test_plates_that_move_go_to_and_fro_and_change_the_speed():
    """At 5 mm/s a way of 2 mm takes 0.4 s; all of it but the first way, which begins in the middle, is uniform."""
    [effect] = [effect for effect in effects.EFFECTS if effect.travel]
    scene, same = effect.scenes()
    device = Simulator(scene)
    device.command(motor_speed=effects.SPEED)
    gaps = []
    for turn in range(5):
        effects.send_plates(device, turn, effect.travel)
        device.advance_to(0.4 * (turn + 1))
        gaps.append(device.state.upper_plate_position - scene["crank.upper_rod"])
    np.testing.assert_allclose(gaps, [1e-3, -1e-3, 1e-3, -1e-3, 1e-3], rtol=0.0, atol=1e-12)
    row = measure(effect, 2.0, 1, 1)
    assert same == scene and row.cost > 0.0 and abs(row.speed_with - row.speed_without)[0] > 1e-4


def test_mean_speeds_are_the_body_s_way_over_its_time():
    """Without friction nothing moves the centre of gravity, and the body stays; with it, backwards, from any start."""
    row = measure(EFFECTS["friction"], 2.0, 2, 1)
    assert row.cost > 0.0
    assert np.all(abs(row.speed_without) < 0.01)  # a swing of m3/M 4 cm, at the most, in 2 s
    assert np.all(row.speed_with < -0.05)
    assert effects.as_line(row).startswith("| friction |")


def test_the_documents_mean_speeds_are_still_the_robots():
    """Rows whose eight starts all ended in one motion, by one start: to 0.5 mm/s, a swing of 1 cm in 20 s."""
    document = (Path(__file__).resolve().parents[2] / "docs" / "robot.md").read_text(encoding="utf-8")
    table = document.partition(effects.BEGIN)[2].partition(effects.END)[0]
    rows = [line.removeprefix("| ").split(" | ") for line in table.splitlines() if line[:2] == "| " and "±" in line]
    steady = {row[0]: float(row[6].split()[0]) for row in rows if row[6].endswith("± 0.0")}
    assert len(steady) > 5
    for name, speed in steady.items():
        _, without = EFFECTS[name].scenes()
        assert mean_speeds(without, 20.0, 1)[0] * 1e3 == pytest.approx(speed, abs=0.5), name

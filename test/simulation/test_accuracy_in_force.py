"""What is said of the accuracy in force is known, and holds."""

import pytest

import vibro_ros
from tools.work_weights import STEPPED, UNKEPT, known_scenes
from vibro_ros.simulation import accuracy_in_force as in_force
from vibro_ros.simulation.accuracy_in_force import KNOWN, KNOWN_SPEED, accuracy_in_force, next_cheaper_choice
from vibro_ros.simulation.auto import choose_method, counted_work


def test_what_is_known_of_the_shipped_scenes_is_what_is_found_now():
    """Counts and errors hardly depend on the machine; else copy what `work_weights` prints."""
    assert tuple(KNOWN) == STEPPED
    for name, known in KNOWN.items():
        found = choose_method(vibro_ros.load_scene(name).with_parameters(
            {"motor.speed": KNOWN_SPEED, "solver.method": "auto", "solver.accuracy": UNKEPT}))
        assert found.exact_cost == pytest.approx(known.exact_cost, rel=0.01), name
        assert found.cheaper.method == known.cheaper.method
        assert found.cheaper[1:] == pytest.approx(known.cheaper[1:], rel=0.05), name
        assert f'"{name}": Known(' in known_scenes()


def test_exact_is_the_cheaper_choice_for_who_steps_finely():
    scene = vibro_ros.load_scene("device").with_parameters({"solver.method": "rk4", "solver.step": 1e-5})
    told = next_cheaper_choice(scene, None)
    ratio = KNOWN["device"].exact_cost / counted_work(scene, 100_000)
    assert told.startswith(f"exact: {ratio:.2g} of the work") and ratio < 0.1
    assert accuracy_in_force(scene, None).startswith("not known")
    coarse = scene.with_parameters({"solver.method": "moreau", "solver.step": 1e-2})
    assert next_cheaper_choice(coarse, None).startswith("none")


def test_what_auto_has_found_is_told():
    scene = vibro_ros.load_scene("device").with_parameters({"solver.method": "auto", "solver.accuracy": 1e-3})
    device = vibro_ros.Simulator(scene)
    told = accuracy_in_force(device.scene, device.choice)
    assert told.startswith(f"{device.choice.error:.2g} m for the first 0.2 s, of 0.001 m asked for")
    cheaper = device.choice.cheaper
    assert next_cheaper_choice(device.scene, device.choice) == (
        f"{cheaper.method}, step {cheaper.step:.3g} s: {cheaper.cost / device.choice.cost:.2g} of the work, but off by "
        f"{cheaper.error:.2g} m in the first 0.2 s")
    assert cheaper.error > 1e-3 / 2.0


def test_nothing_is_claimed_of_another_machine():
    scene = vibro_ros.load_scene("device")
    assert accuracy_in_force(scene, None).startswith("rounding: 8.6e-13 m for 0.2 s")
    for changed in ({"mass.upper": 0.11}, {"upper.gap": 1e-4}):
        assert next_cheaper_choice(scene.with_parameters(changed), None) == in_force._UNKNOWN
    assert next_cheaper_choice(scene.with_parameters({"motor.speed": 50.0, "solver.tolerance": 1e-6}), None) != (
        in_force._UNKNOWN)

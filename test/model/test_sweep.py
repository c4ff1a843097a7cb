"""A sweep compiles the numbers of each scene anew, and what depends on the effects alone only once."""

import functools
import importlib
import pkgutil

import numpy as np
import pytest

import vibro_ros
from vibro_ros import model, solver
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.model.tables import compile_scene


@functools.cache
def caches():
    """Every cache of the rooms that make tables."""
    modules = [importlib.import_module(f"{room.__name__}.{module.name}") for room in (model, solver)
               for module in pkgutil.iter_modules(room.__path__)]
    return [function for module in modules for function in vars(module).values() if hasattr(function, "cache_clear")]


def forget():
    """Forget everything that has been compiled, so that earlier tests do not matter."""
    for cache in caches():
        cache.cache_clear()


def arrays(table):
    """All arrays of a system by name, as shapes and bytes."""
    return {name: (value.shape, value.tobytes()) if isinstance(value, np.ndarray) else arrays(value)
            for name, value in table._asdict().items()}


def tables(scene):
    """All tables of a device of the scene."""
    compiled = compile_scene(scene)
    return arrays(compiled.system), compiled.output.tobytes(), compiled.sliders


def other_values(parameter, value):
    """Values of a parameter other than `value`, some of which a scene may refuse."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, float):
        return [value * 1.0625 + (1e-4 if value == 0.0 else 0.0), 0.0]
    return [choice for choice in parameter.choices if choice != value]


def changed_scenes(base):
    """Yield the scenes that differ from `base` in one parameter, for every parameter and some of its values."""
    for parameter in SCENE_PARAMETERS:
        for value in other_values(parameter, base[parameter.name]):
            try:
                yield base.with_parameters({parameter.name: value})
            except ValueError:
                continue


@pytest.mark.parametrize("name", shipped_scenes())
def test_tables_of_a_changed_scene_are_those_of_a_process_that_compiled_no_other(name):
    base = vibro_ros.load_scene(name)
    changed = {scene.machine: scene for scene in changed_scenes(base)}
    assert len(changed) > 40
    tables(base)
    after_others = [tables(scene) for scene in changed.values()]
    for scene, warm in zip(changed.values(), after_others, strict=True):
        forget()
        assert warm == tables(scene)


def misses():
    """How often each cache had to compute its result so far, by the function's name."""
    return {cache.__name__: cache.cache_info().misses for cache in caches() if cache.cache_info().maxsize}


OF_EFFECTS = {"ModeSet", "_guard_indices", "_equation_terms", "_terms_by_mode", "_terms_by_zeros", "_no_accounts"}
ALL = OF_EFFECTS | {"signal_table", "_longest_segments", "_compile_machine", "check_machine"}


@pytest.mark.parametrize(("name", "parameter", "kept"), [
    ("device", "guide.angle", OF_EFFECTS), ("device", "upper.spring.damping", OF_EFFECTS | {"signal_table"}),
    ("damped", "ground.friction", OF_EFFECTS | {"signal_table", "_longest_segments"}),
    ("machine", "motor.supply_voltage", OF_EFFECTS | {"signal_table", "_longest_segments"}),
    ("device", "motor.max_speed", ALL), ("device", "motor.supply_voltage", ALL), ("paper", "motor.speed", ALL),
    ("device", "gap_actuator.speed", ALL)])
def test_a_sweep_makes_only_what_its_parameter_touches(name, parameter, kept):
    forget()
    scene = vibro_ros.load_scene(name)
    vibro_ros.Simulator(scene)
    misses_before = misses()
    assert kept <= misses_before.keys()
    for k in range(1, 6):
        vibro_ros.Simulator(scene.with_parameters({parameter: scene[parameter] * (1.0 - 0.01 * k)}))
    after = misses()
    assert {function for function in kept if after[function] != misses_before[function]} == set()
    made = {"_compile_machine", "check_machine"} - kept
    assert all(after[function] == misses_before[function] + 5 for function in made)


@pytest.mark.parametrize("changes", [
    {"effects.upper_contact": "restitution"}, {"effects.friction": "none"}, {"guide.angle": 0.0},
    {"gravity": 0.0}, {"upper.plate.stiffness": 0.0}, {"ground.friction": 1e-3, "ground.static_friction": 1e-3}],
    ids=lambda changes: next(iter(changes)))
def test_scenes_that_were_compiled_before_change_no_bit(changes):
    """The previously compiled scene has other effects, or forms that vanish or coincide, so that it has other guards
    and rows.
    """
    earlier_scene = vibro_ros.load_scene("device").with_parameters({"effects.normal_force": "unilateral"})
    scene = earlier_scene.with_parameters(changes)
    tables(earlier_scene)
    after_another = tables(scene)
    forget()
    assert after_another == tables(scene)

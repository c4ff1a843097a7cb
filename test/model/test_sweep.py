"""A sweep compiles the numbers of each scene anew, and what depends on the effects alone only once."""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.modes import mode_set
from vibro_ros.model.tables import _compile_machine, compile_scene
from vibro_ros.solver.equations import _terms_by_zeros


def forget():
    """Forget everything that has been compiled, so that earlier tests do not matter."""
    for cache in (_compile_machine, _terms_by_zeros, mode_set):
        cache.cache_clear()


def arrays(table):
    """All arrays of a system by name, as bytes."""
    return {name: value.tobytes() if isinstance(value, np.ndarray) else arrays(value)
            for name, value in table._asdict().items()}


@pytest.mark.parametrize("changes", [
    {"effects.upper_contact": "restitution"}, {"effects.friction": "none"}, {"guide.angle": 0.0},
    {"gravity": 0.0}, {"upper.plate.stiffness": 0.0}, {"ground.friction": 1e-3, "ground.static_friction": 1e-3}],
    ids=lambda changes: next(iter(changes)))
def test_what_was_compiled_before_changes_no_bit(changes):
    """The previously compiled scene has other effects, or forms that vanish or coincide, so that it has other guards
    and rows.
    """
    before = vibro_ros.load_scene("device").with_parameters({"effects.normal_force": "unilateral"})
    scene = before.with_parameters(changes)
    compile_scene(before)
    after_another = arrays(compile_scene(scene).system)
    forget()
    assert after_another == arrays(compile_scene(scene).system)

"""`Scene.describe` says what the compiled tables hold: no more, no less."""

import math
import re

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.forms import Forms
from vibro_ros.model.symbols import Symbols, multiple
from vibro_ros.model.tables import compile_scene
from vibro_ros.scene_file import shipped_scenes
from vibro_ros.solver.system import NOTHING

VARIANTS = {
    "one guide": {"effects.inclined_mass": False}, "no guide": {"effects.inclined_mass": False,
                                                                "effects.upper_mass": False},
    "upright": {"guide.angle": 0.0}, "one plate": {"effects.upper_contact": "none"}, "l = L": {"crank.radius": 0.06},
    "smooth ground": {"ground.friction": 0.0}, "weight": {"effects.normal_force": "weight"},
    "reaction": {"effects.reaction": True, "effects.mass_weight": True}, "static": {"effects.friction": "static"},
    "stribeck": {"effects.friction": "stribeck"},
    "stribeck, weight": {"effects.friction": "stribeck", "effects.normal_force": "weight"},
    "rigid reaction": {"effects.reaction": True, "effects.normal_force": "unilateral",
                       "effects.upper_contact": "restitution", "effects.inclined_contact": "restitution"},
    "hop": {"effects.normal_force": "hop"}, "hop on ice": {"effects.normal_force": "hop", "effects.friction": "none"},
    "hop reaction": {"effects.normal_force": "hop", "effects.reaction": True, "effects.mass_weight": True},
    "hop, rigid": {"effects.normal_force": "hop", "effects.reaction": True, "effects.upper_contact": "restitution",
                   "effects.inclined_contact": "restitution"},
    "hop upright": {"effects.normal_force": "hop", "effects.reaction": True, "guide.angle": 0.0},
    "hop, one guide": {"effects.normal_force": "hop", "effects.inclined_mass": False},
    "hop, no guide": {"effects.normal_force": "hop", "effects.inclined_mass": False, "effects.upper_mass": False},
    "no tension": {"effects.adhesion": False, "upper.plate.damping": 50.0}}
SCENES = [vibro_ros.load_scene(name) for name in shipped_scenes()]
SCENES += [vibro_ros.Scene(name, changes) for name, changes in VARIANTS.items()]
each_scene = pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)


def sections(scene) -> dict[str, list[str]]:
    """Lines of each section of the description, by the first word of its title."""
    blocks = [block.splitlines() for block in scene.describe().strip().split("\n\n")]
    return {block[0].split()[0].rstrip(":"): [line.strip() for line in block[1:]] for block in blocks}


def value_of(text: str, values: dict[str, float]) -> float:
    """The value of a sum as the description writes it."""
    text = re.sub(r"(\d) (?=[a-zA-Z(])", r"\1 * ", re.sub(r"- (?=[a-z(])", "- 1 * ", text))
    names = sorted(values, key=len, reverse=True)
    for name in names:
        text = re.sub(rf"(?<![\w']){re.escape(name)}(?![\w'])", f"({values[name]!r})", text)
    return eval(text, {"__builtins__": {}})


def random_point(forms: Forms) -> np.ndarray:
    """Some values of the channels."""
    return np.append(np.random.default_rng(1).uniform(0.5, 1.5, forms.channels.one), 1.0)


def symbol_values(forms: Forms, z: np.ndarray) -> dict[str, float]:
    """Value of every symbol at the channels z."""
    at, values = forms.channels, {}
    for i, symbol in enumerate([{"upper": "u", "inclined": "w"}[side] for side in forms.guides]):
        slider = {"u": "s_B", "w": "s_C"}[symbol]
        values |= {slider: z[at.signal(i)], f"{slider}'": z[at.signal_rate(i)], f"{symbol}''": z[at.acceleration(i)],
                   symbol: z[at.position(i)], f"{symbol}'": z[at.velocity(i)]}
    for k, side in enumerate(forms.plates):
        plate = {"upper": "E", "inclined": "H"}[side]
        values |= {plate: z[at.ramp(k)], f"{plate}'": z[at.ramp_rate(k)]}
    return {name: float(value) for name, value in values.items()}


def holds_in(line: str, states: tuple[str, ...], plates: tuple[str, ...]) -> bool:
    """Whether the cases after "while" of an equation, if there are any, hold for the states of a mode."""
    _, _, cases = line.partition("while ")
    now = {f"{side} contact {state}" for side, state in zip((*plates, ""), states, strict=True)}
    now |= {f"friction {states[-1]}", f"ground {states[-1]}"}
    return not cases or any(set(case.split(" and ")) <= now for case in cases.split(" or "))


@each_scene
def test_every_coordinate_and_no_other_is_a_state(scene):
    lines = sections(scene)["states"]
    assert sum("'" in line for line in lines) == compile_scene(scene).forms.channels.coordinates
    assert any(line.startswith("x = 0") for line in lines) != compile_scene(scene).forms.body_moves
    assert any(line.startswith("y, y'") for line in lines) == compile_scene(scene).forms.body_hops


@each_scene
def test_number_of_modes(scene):
    assert int(sections(scene)["modes"][0].split()[0]) == len(compile_scene(scene).modes)


@each_scene
def test_guards_of_every_mode_are_told(scene):
    """A mode's guards are those of its states: as many rows in the tables as lines in the text."""
    model, told = compile_scene(scene), sections(scene).get("guards", [])
    for mode, rows in zip(model.modes, model.system.guard, strict=True):
        ground = "friction" if any("slip" in line for line in told) else "ground"
        parts = [f"{side} contact" for side in model.forms.plates] + [ground]
        lines = [line for line in told for part, state in zip(parts, mode.states, strict=True)
                 if line.startswith(f"{part} {state}:")]
        assert len(lines) == np.count_nonzero(rows != NOTHING)
        assert len(set(lines)) == len(lines)


@each_scene
def test_equations_of_the_masses_have_the_tables_values(scene):
    """At random channels; the text has six digits."""
    model, lines = compile_scene(scene), sections(scene).get("equations", [])
    forms = model.forms
    z = random_point(forms)
    values = symbol_values(forms, z)
    for i, side in enumerate(forms.guides):
        symbol = {"upper": "u", "inclined": "w"}[side]
        own = [line for line in lines if re.match(rf"\S+ {symbol}'' =", line)]
        for mode, rows in zip(model.modes, model.system.acceleration, strict=True):
            [line] = [line for line in own if holds_in(line, mode.states, forms.plates)]
            mass, _, right = line.partition(f" {symbol}'' = ")
            right = right.partition("  ")[0]
            assert value_of(right, values) == pytest.approx(float(mass) * float(rows[i] @ z), rel=1e-5)


@each_scene
def test_equation_of_the_body_has_the_tables_values(scene):
    model, lines = compile_scene(scene), sections(scene).get("equations", [])
    told = {line.partition(" = ")[0]: line.partition(" = ")[2].partition("  ")[0] for line in lines}
    if not model.forms.body_moves:
        assert not [name for name in told if "x" in name or name in ("F_in", "F_fr")]
        return
    z = random_point(model.forms)
    values = symbol_values(model.forms, z)
    values["F_in"] = value_of(told["F_in"], values)
    values["N"] = value_of(told.get("N", "0"), values)
    if model.forms.friction_decays:
        values["D"] = float(z[model.forms.channels.decay])
    law = re.compile(rf"N exp\(-\|x'\|/{scene['ground.stribeck_speed']:g}\)")
    frictions = {line.rpartition("while ")[2]: law.sub("D", line.partition(" = ")[2].partition("  ")[0])
                 for line in lines if line.startswith("F_fr")}
    [mass] = [name.partition(" ")[0] for name in told if name.endswith("x''")]
    for mode, rows in zip(model.modes, model.system.acceleration, strict=True):
        friction = value_of(frictions.get(mode.states[-1], "0"), values)
        inertia = float(mass) * float(rows[model.forms.body] @ z)
        assert inertia == pytest.approx(values["F_in"] - friction, rel=1e-5, abs=1e-12)


@each_scene
def test_equation_of_the_height_has_the_tables_values(scene):
    model, lines = compile_scene(scene), sections(scene).get("equations", [])
    told = [line for line in lines if re.match(r"\S+ y'' =", line)]
    if not model.forms.body_hops:
        assert not told
        return
    [line] = told
    z = random_point(model.forms)
    mass, _, right = line.partition("  ")[0].partition(" y'' = ")
    for mode, rows in zip(model.modes, model.system.acceleration, strict=True):
        lift = value_of(right, symbol_values(model.forms, z)) if mode.states[-1] == "airborne" else 0.0
        assert float(mass) * float(rows[model.forms.height] @ z) == pytest.approx(lift, rel=1e-5)


@each_scene
def test_nothing_of_an_effect_that_is_off(scene):
    forms, text = compile_scene(scene).forms, scene.describe().partition("\n")[2]  # without its name
    absent = {"upper": ("u''", "s_B", "upper mass"), "inclined": ("w''", "s_C", "inclined mass")}
    words = [word for side in absent if side not in forms.guides for word in absent[side]]
    words += [f"{side}_contact" for side in ("upper", "inclined") if side not in forms.plates]
    words += [word for side, word in (("upper", "(u - E)"), ("inclined", "(w - H)")) if side not in forms.plates]
    if scene["effects.friction"] == "none" or scene["ground.friction"] == 0.0 or not forms.body_moves:
        words += ["friction", "slip", "μ"] + ["N ="] * (not forms.body_hops)
    words += [] if forms.body_hops else ["y'", "airborne", "lift_off", "landing", "leaves"]
    words += [] if forms.friction_decays else ["exp"]
    if scene["effects.motor"] == "ideal":
        words += ["ramp", "rad/s²"]
    words += [] if scene["solver.audit"] and forms.guides else ["audit"]
    words += [] if scene["upper.spring.damping"] or scene["inclined.spring.damping"] else ["(u' - s_B')"]
    assert [word for word in words if word in text] == []


@each_scene
def test_only_recorded_kinds_are_events(scene):
    device = vibro_ros.Simulator(scene)
    device.advance_to(0.2)
    device.command(motor_speed=90.0, upper_gap=1e-4, inclined_gap=1e-4)
    device.advance_to(1.0)
    assert set(device.take_events()["kind"]) <= set(sections(scene)["events"][0].split(", "))


def test_no_coefficient_is_zero():
    for scene in SCENES:
        for line in sections(scene).get("equations", []):
            assert not re.search(r"[-+=] 0 [uwxNF(]|e-1[5-9]", line), line


def test_forms_are_written_as_the_paper_does():
    forms = Forms(vibro_ros.Scene("damped", {"upper.spring.damping": 2.0, "upper.plate.damping": 0.5}))
    write = Symbols(forms).text
    assert write(-forms.guide_force("upper", frozenset({"upper"}))) == (
        "-1000 (u - s_B) - 2 (u' - s_B') - 1e+07 (u - E) - 0.5 (u' - E')")
    assert write(forms.position(0) - 2.5 * forms.one) == "u - 2.5"
    assert write(forms.zero) == "0"


def test_a_multiple_is_told_from_another_form():
    one, other = np.array([1.0, -3.0, 0.0]), np.array([1.0, -3.0, 1e-6])
    assert multiple(-0.2 * one, one) == pytest.approx(-0.2, rel=1e-15)
    assert multiple(other, one) is None
    assert multiple(0.0 * one, one) == 0.0
    assert math.isclose(multiple(one, one), 1.0)

"""`Scene.describe` describes the compiled tables completely, and nothing else."""

import re

import numpy as np
import pytest

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.model.forms import Forms
from vibro_ros.model.modes import Mode
from vibro_ros.model.motor import BEARING
from vibro_ros.model.slider import Slider
from vibro_ros.model.tables import compile_scene
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
    "misprint": {"effects.misprint": True},
    "misprint, no tension, hop": {"effects.misprint": True, "effects.normal_force": "hop", "effects.adhesion": False,
                                  "inclined.plate.damping": 50.0},
    "hop": {"effects.normal_force": "hop"}, "hop on ice": {"effects.normal_force": "hop", "effects.friction": "none"},
    "hop reaction": {"effects.normal_force": "hop", "effects.reaction": True, "effects.mass_weight": True},
    "hop, rigid": {"effects.normal_force": "hop", "effects.reaction": True, "effects.upper_contact": "restitution",
                   "effects.inclined_contact": "restitution"},
    "hop upright": {"effects.normal_force": "hop", "effects.reaction": True, "guide.angle": 0.0},
    "hop, one guide": {"effects.normal_force": "hop", "effects.inclined_mass": False},
    "hop, no guide": {"effects.normal_force": "hop", "effects.inclined_mass": False, "effects.upper_mass": False},
    "hop, rigid, one guide": {"effects.normal_force": "hop", "effects.reaction": True, "effects.mass_weight": True,
                              "effects.upper_contact": "restitution", "effects.inclined_mass": False},
    "dc": {"effects.motor": "dc"}, "dc, voltage, hop": {
        "effects.motor": "dc", "motor.control": "voltage", "motor.winding_inductance": 1e-3, "motor.speed": 0.0,
        "effects.normal_force": "hop", "effects.reaction": True, "mass.upper_slider": 0.01},
    "dc without a bearing": {"effects.motor": "dc", "motor.friction": 0.0, "motor.static_friction": 0.0},
    "lag": {"effects.motor": "lag"}, "no tension": {"effects.adhesion": False, "upper.plate.damping": 50.0}}
SCENES = [vibro_ros.load_scene(name) for name in shipped_scenes()]
SCENES += [vibro_ros.Scene(name, changes) for name, changes in VARIANTS.items()]
each_scene = pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)


def sections(scene) -> dict[str, list[str]]:
    """Lines of each section of the description, by the first word of its title."""
    blocks = [block.splitlines() for block in scene.describe().strip().split("\n\n")]
    return {block[0].split()[0].rstrip(":"): [line.strip() for line in block[1:]] for block in blocks}


def value_of(text: str, values: dict[str, float]) -> float:
    """The value of a sum as the description writes it."""
    text = re.sub(r"(\d) (?=[a-zA-Zθ(])", r"\1 * ", re.sub(r"- (?=[a-z(])", "- 1 * ", text))
    names = sorted(values, key=len, reverse=True)
    for name in names:
        text = re.sub(rf"(?<![\w']){re.escape(name)}(?![\w'])", f"({values[name]!r})", text)
    return eval(text, {"__builtins__": {}})


def random_point(forms: Forms) -> np.ndarray:
    """Return random values of the channels."""
    return np.append(np.random.default_rng(1).uniform(0.5, 1.5, forms.channels.one), 1.0)


def balanced_point(row: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return values of the channels for which no term of a form hides another by its magnitude."""
    size = np.abs(np.where(row == 0.0, 1.0, row))
    z = random.choice([-1.0, 1.0], len(row)) * random.uniform(0.5, 1.5, len(row)) * size[-1] / size
    z[-1] = 1.0
    return z


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
    if forms.has_rotor:
        values |= {"θ'": z[at.velocity(forms.phase)], "i": z[at.velocity(forms.charge)], "T": z[at.torque],
                   "h": z[at.held]}
        values |= {f"{symbol}''": z[at.signal_acceleration(k)]
                   for k, symbol in enumerate(("s_B", "s_C")[:at.signal_accelerations])}
    for symbol, i in [("x", forms.body)] * forms.body_moves + [("y", forms.height)] * forms.body_hops:
        values |= {symbol: z[at.position(i)], f"{symbol}'": z[at.velocity(i)]}
    return {name: float(value) for name, value in values.items()}


def force_values(described: dict[str, list[str]], mode: Mode, plates: tuple[str, ...],
                 values: dict[str, float]) -> dict[str, float]:
    """Return `values` together with those of the forces that the description defines, in a mode."""
    values = dict(values)
    for line in described.get("equations", []):
        name, _, right = line.partition(" = ")
        if (name in ("F_in", "N") or name.startswith("force on")) and holds_in(line, mode.states, plates):
            values[name] = value_of(right.partition("  ")[0], values)
    return values


def guard_lines(described: dict[str, list[str]], mode: Mode, plates: tuple[str, ...]) -> list[tuple[int, str]]:
    """The guards of a mode as described: the places of their effects among its states, and the text after them."""
    lines = [line for line in described.get("guards", []) if holds_in(line, mode.states, plates)]
    heads = [tuple(f"{name}: " for name in names) for names in named_states(mode.states, plates)]
    return [(place, line.partition(": ")[2]) for place, head in enumerate(heads) for line in lines
            if line.startswith(head)]


def condition_value(condition: str, values: dict[str, float]) -> float:
    """Return the margin by which an inequality holds, negative if it does not hold."""
    left, sign, right = re.fullmatch(r"(.+) (<=|>=) (.+)", condition).groups()
    difference = value_of(right, values) - value_of(left, values)
    return difference if sign == "<=" else -difference


def described_targets(text: str, states: tuple[str, ...], place: int, plates: tuple[str, ...]) -> list[tuple[str, ...]]:
    """States of the modes that a guard leads to, each once."""
    targets = []
    for target in re.split(", with|, where", text)[0].split(" or "):
        after = list(states)
        after[place], *others = target.split(" and ")
        for other in others:
            side, _, state = other.partition(" contact ")
            bearing = other.removeprefix("bearing ")
            after[plates.index(side) if state else len(plates) if bearing != other else -1] = state or bearing
        targets.append(tuple(after))
    return list(dict.fromkeys(targets))


def named_states(states: tuple[str, ...], plates: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return, for each effect, the names that the description may give its states."""
    motor = [f"{'bearing' if state in BEARING else 'current loop'} {state}" for state in states[len(plates):-1]]
    return [*((f"{side} contact {state}",) for side, state in zip(plates, states, strict=False)),
            *((name,) for name in motor), (f"friction {states[-1]}", f"ground {states[-1]}")]


def holds_in(line: str, states: tuple[str, ...], plates: tuple[str, ...]) -> bool:
    """Whether the cases of an equation, after "while" or after a remark, apply to the states of a mode."""
    remark = re.search(r"(?:; where |  while (?!airborne, else))(.*)", line)
    cases = remark[1] if remark else ""
    now = {name for names in named_states(states, plates) for name in names}
    return not cases or any(set(case.split(" and ")) <= now for case in cases.split(" or "))


@each_scene
def test_coordinates_number_of_modes_and_first_mode_are_those_of_the_tables(scene):
    """Friction that has only one state is not described."""
    model, described = compile_scene(scene), sections(scene)
    lines = described["states"]
    assert sum("'" in line for line in lines) == model.forms.channels.coordinates
    assert any(line.startswith("x = 0") for line in lines) != model.forms.body_moves
    assert any(line.startswith("y, y'") for line in lines) == model.forms.body_hops
    number, _, first = described["modes"][0].partition("; first ")
    assert int(number.split()[0]) == len(model.modes)
    states = model.modes[model.initial_mode].states
    if scene.has_rotor and scene["motor.speed"] and scene["motor.static_friction"]:
        assert first == "that of a crank that turns"
        return
    several = [len({mode.states[k] for mode in model.modes}) > 1 for k in range(len(states))]
    assert first == ", ".join(state for state, one_of in zip(states, several, strict=True) if one_of)


@pytest.mark.process
@each_scene
def test_guards_of_every_mode_are_described(scene):
    """A mode's guards are those of its states: as many rows in the tables as lines in the text, each with the value of
    its row at random channels (the text has six digits) and with the candidates of the tables."""
    model, described, random = compile_scene(scene), sections(scene), np.random.default_rng(2)
    system, plates = model.system, model.forms.plates
    for m, mode in enumerate(model.modes):
        lines = guard_lines(described, mode, plates)
        assert len(lines) == len(set(lines)) == np.count_nonzero(system.guards.row[m] != NOTHING)
        for g, (place, line) in enumerate(lines):
            condition, targets, *_ = re.split(" {2,}(?:else|while) ", line)
            row = system.guards.form[system.guards.row[m, g]]
            for _ in range(3):
                z = balanced_point(row, random)
                value = condition_value(condition, force_values(described, mode, plates, symbol_values(model.forms, z)))
                assert value == pytest.approx(row @ z, rel=0.0, abs=1e-5 * (np.abs(row) @ np.abs(z)))
            candidates = [model.modes[c].states for c in system.guards.candidate[m, g] if c != NOTHING]
            assert described_targets(targets, mode.states, place, plates) == list(dict.fromkeys(candidates))


def formula_value(text: str, angle: np.ndarray) -> np.ndarray:
    """A slider's position as the description writes it, at crank angles."""
    text = re.sub(r"(cos|sin)(²?) (θ|\([^)]*\))", lambda part: f"{part[1]}({part[3]}){'**2' * bool(part[2])}", text)
    text = re.sub(r"\|([^|]*)\|", r"abs(\1)", text).replace("²", "**2").replace("√", "sqrt")
    text = re.sub(r"([\d.]) (?=[a-z(])", r"\1 * ", text)
    return eval(text, {"__builtins__": {}, "cos": np.cos, "sin": np.sin, "sqrt": np.sqrt, "abs": np.abs, "θ": angle})


@each_scene
def test_described_drives_are_those_of_the_scene(scene):
    """Sliders at random angles, to the text's six digits; where motor and plates stand, and how they follow a command.
    """
    described = dict(line.split(" = ") for line in sections(scene)["known"])
    forms, angles = compile_scene(scene).forms, np.random.default_rng(3).uniform(-9.0, 9.0, 40)
    for side in forms.guides:
        slider = Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], scene.guide_angle(side))
        places = formula_value(described[{"upper": "s_B", "inclined": "s_C"}[side]], angles)
        np.testing.assert_allclose(places, slider.position(angles), rtol=0.0, atol=1e-5 * (slider.radius + slider.rod))
    laws = {"E" if side == "upper" else "H": (f"{scene[f'crank.{side}_rod'] + scene[f'{side}.gap']:g} m",
                                              f"at {scene['gap_actuator.speed']:g} m/s") for side in forms.plates}
    if scene.has_rotor:
        assert described["h"].split()[1] == ("A" if scene["motor.control"] == "speed_by_current" else "V")
    else:
        laws["θ'"] = f"{scene['motor.speed']:g} rad/s", {
            "ideal": "at once", "ramp": f"at {scene['motor.acceleration']:g} rad/s²",
            "lag": f"with a time constant of {scene['motor.time_constant']:g} s"}[scene["effects.motor"]]
    assert {name: tuple(re.split(" +follows a command ", described[name])) for name in laws} == laws
    assert len(described) == 1 + len(forms.guides) + len(forms.plates)


@each_scene
def test_equations_of_the_masses_have_the_tables_values(scene):
    """At random channels; the text has six digits."""
    model, lines = compile_scene(scene), sections(scene).get("equations", [])
    forms = model.forms
    z = random_point(forms)
    values = symbol_values(forms, z)
    for i, side in enumerate(forms.guides):
        symbol = {"upper": "u", "inclined": "w"}[side]
        equations = [line for line in lines if re.match(rf"\S+ {symbol}'' =", line)]
        for mode, rows in zip(model.modes, model.system.equations, strict=True):
            [line] = [line for line in equations if holds_in(line, mode.states, forms.plates)]
            mass, _, right = line.partition(f" {symbol}'' = ")
            right = right.partition("  ")[0]
            assert value_of(right, values) == pytest.approx(float(mass) * float(rows[i] @ z), rel=1e-5)


@each_scene
def test_equation_of_the_body_has_the_tables_values(scene):
    model, lines = compile_scene(scene), sections(scene).get("equations", [])
    described = {line.partition(" = ")[0] for line in lines}
    if not model.forms.body_moves:
        assert not [name for name in described if "x" in name or name in ("F_in", "F_fr")]
        return
    z = random_point(model.forms)
    values = symbol_values(model.forms, z)
    if model.forms.friction_decays:
        values["D"] = float(z[model.forms.channels.decay])
    law = re.compile(rf"N exp\(-\|x'\|/{scene['ground.stribeck_speed']:g}\)")
    frictions = {line.rpartition("while ")[2]: law.sub("D", line.partition(" = ")[2].partition("  ")[0])
                 for line in lines if line.startswith("F_fr")}
    [mass] = [name.partition(" ")[0] for name in described if name.endswith("x''")]
    for mode, rows in zip(model.modes, model.system.equations, strict=True):
        forces = force_values({"equations": lines}, mode, model.forms.plates, values)
        friction = value_of(frictions.get(mode.states[-1], "0"), forces)
        inertia = float(mass) * float(rows[model.forms.body] @ z)
        rounding = 1e-5 * np.abs(float(mass) * rows[model.forms.body]) @ np.abs(z) if scene["effects.misprint"] else 0.0
        assert inertia == pytest.approx(forces["F_in"] - friction, rel=1e-5, abs=1e-12 + rounding)


@each_scene
def test_equation_of_the_height_has_the_tables_values(scene):
    model, lines = compile_scene(scene), sections(scene).get("equations", [])
    described = [line for line in lines if re.match(r"\S+ y'' =", line)]
    if not model.forms.body_hops:
        assert not described
        return
    z = random_point(model.forms)
    for mode, rows in zip(model.modes, model.system.equations, strict=True):
        [line] = [line for line in described if holds_in(line, mode.states, model.forms.plates)]
        mass, _, right = line.partition("  ")[0].partition(" y'' = ")
        lift = value_of(right, symbol_values(model.forms, z)) if mode.states[-1] == "airborne" else 0.0
        assert float(mass) * float(rows[model.forms.height] @ z) == pytest.approx(lift, rel=1e-5)


@each_scene
def test_an_effect_that_is_off_is_not_described(scene):
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
    words += [] if scene["upper.spring.damping"] or scene["inclined.spring.damping"] else ["(u' - s_B')"]
    assert [word for word in words if word in text] == []


@each_scene
def test_only_recorded_kinds_are_events(scene):
    device = vibro_ros.Simulator(scene)
    device.advance_to(0.2)
    device.command(**{scene.motor_command: 20.0 if scene.motor_command == "motor_voltage" else 90.0}, upper_gap=1e-4,
                   inclined_gap=1e-4)
    device.advance_to(1.0)
    assert set(device.take_events()["kind"]) <= set(sections(scene)["events"][0].split(", "))


def test_no_coefficient_is_zero():
    for scene in SCENES:
        for line in sections(scene).get("equations", []):
            assert not re.search(r"[-+=] 0 [uwxNF(]|e-1[5-9]", line), line

"""Reads `Scene.describe()`: values of its formulas, and its lines for one mode."""

import re

import numpy as np

from vibro_ros.model.forms import Forms
from vibro_ros.model.modes import Mode


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


def balanced_point(row: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Values of the channels by which the terms of a form are about equally large, so that none hides another."""
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
    for symbol, i in [("x", forms.body)] * forms.body_moves + [("y", forms.height)] * forms.body_hops:
        values |= {symbol: z[at.position(i)], f"{symbol}'": z[at.velocity(i)]}
    return {name: float(value) for name, value in values.items()}


def force_values(described: dict[str, list[str]], mode: Mode, plates: tuple[str, ...],
                 values: dict[str, float]) -> dict[str, float]:
    """`values` with those of the forces that the description defines, in a mode."""
    values = dict(values)
    for line in described.get("equations", []):
        name, _, right = line.partition(" = ")
        if (name in ("F_in", "N") or name.startswith("force on")) and holds_in(line, mode.states, plates):
            values[name] = value_of(right.partition("  ")[0], values)
    return values


def guard_lines(described: dict[str, list[str]], mode: Mode, plates: tuple[str, ...]) -> list[tuple[int, str]]:
    """The guards of a mode as described: the places of their effects among its states, and the text after them."""
    lines = [line for line in described.get("guards", []) if holds_in(line, mode.states, plates)]
    heads = [(f"{side} contact {state}: ",) for side, state in zip(plates, mode.states, strict=False)]
    heads.append((f"friction {mode.ground}: ", f"ground {mode.ground}: "))
    return [(place, line.partition(": ")[2]) for place, head in enumerate(heads) for line in lines
            if line.startswith(head)]


def condition_value(condition: str, values: dict[str, float]) -> float:
    """By how much an inequality holds; negative where it does not."""
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
            after[plates.index(side) if state else -1] = state or other
        targets.append(tuple(after))
    return list(dict.fromkeys(targets))


def holds_in(line: str, states: tuple[str, ...], plates: tuple[str, ...]) -> bool:
    """Whether the cases of an equation, after "while" or after a remark, hold for the states of a mode, if any."""
    found = re.search(r"(?:; where |  while (?!airborne, else))(.*)", line)
    cases = found[1] if found else ""
    now = {f"{side} contact {state}" for side, state in zip((*plates, ""), states, strict=True)}
    now |= {f"friction {states[-1]}", f"ground {states[-1]}"}
    return not cases or any(set(case.split(" and ")) <= now for case in cases.split(" or "))

"""Requests of any service type, filled at random with what is legal, nearly legal and absurd."""

import math
import random
from importlib import import_module
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue

NUMBERS = (0.0, -0.0, 5e-324, 1e-300, 0.1, 1.0, 100.0, 499.0, 1e308, -1.0, -1e308, math.inf, -math.inf, math.nan)
TEXTS = ("", "a", "/", "~", "vibro_robot", "1e-3", "nan", "\x1b[31m", "ünïcödé", "x\ny", "x" * 2000,
         "RIHS01_" + "0" * 64)
UNTOUCHED = ("rate.real_time_factor",)
"""Parameters that would make a test take as long as they like."""


def service_class(type_name: str) -> type:
    """The class of a service type such as ``std_srvs/srv/SetBool``."""
    package, _, name = type_name.partition("/srv/")
    return getattr(import_module(f"{package}.srv"), name)


QUITTING = 3
"""The state of a simulation that ends the robot."""


def random_request(kind: type, names: list[str], chance: random.Random) -> Any:
    """Return a request of a service that answers quickly; most names of parameters are from `names`."""
    request = _filled(kind.Request(), names, chance)
    if hasattr(request, "steps"):
        request.steps = chance.choice((0, 1, 3))
    if getattr(getattr(request, "state", None), "state", None) == QUITTING:
        request.state.state += 1
    return request


def _filled(message: Any, names: list[str], chance: random.Random) -> Any:
    for field, kind in message.get_fields_and_field_types().items():
        setattr(message, field, _value(kind, names, chance))
    return message


def _value(kind: str, names: list[str], chance: random.Random) -> Any:
    if kind.startswith("sequence<"):
        inner = kind.removeprefix("sequence<").removesuffix(">").partition(",")[0]
        return [_one(inner, names, chance) for _ in range(chance.choice((0, 1, 1, 2, 5)))]
    return _one(kind, names, chance)


def _one(kind: str, names: list[str], chance: random.Random) -> Any:
    if kind == "rcl_interfaces/Parameter":
        name = chance.choice(names) if chance.random() < 0.7 else chance.choice(TEXTS)
        return Parameter(name=name, value=_parameter_value(chance))
    if kind == "boolean":
        return chance.random() < 0.5
    if kind.startswith("string"):
        return chance.choice(names if chance.random() < 0.3 else TEXTS)
    if kind in ("double", "float"):
        return chance.choice(NUMBERS)
    if kind.startswith(("int", "uint", "octet", "byte")):
        return _integer(kind, chance)
    package, _, name = kind.partition("/")
    return _filled(getattr(import_module(f"{package}.msg"), name)(), names, chance)


def _integer(kind: str, chance: random.Random) -> int:
    bits = int("".join(filter(str.isdigit, kind)) or 8)
    low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return chance.choice((low, high, 0, 1, min(high, 100), chance.randint(low, high)))


def _parameter_value(chance: random.Random) -> ParameterValue:
    """Draw a value of a parameter, usually a double; of the other types also without the value itself."""
    if chance.random() < 0.6:
        number = chance.choice(NUMBERS) if chance.random() < 0.5 else chance.uniform(0.01, 600.0)
        return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=number)
    return ParameterValue(type=chance.randrange(256) if chance.random() < 0.3 else chance.randrange(10),
                          bool_value=chance.random() < 0.5, integer_value=chance.randrange(-5, 600),
                          string_value=chance.choice(TEXTS), double_array_value=[1.0],
                          string_array_value=["odom"])

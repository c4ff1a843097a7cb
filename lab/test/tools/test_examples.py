"""Each name of the lab, and each of the device that the guide explains, has an example, and its output is right."""

import doctest
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import guide
import pytest

import vibro_lab
import vibro_ros

#: Methods that a user calls, of classes whose other methods are for the physics, or belong to `Simulator`.
USED = {"Scene": ["with_parameters", "describe"], "SensedSimulator": ["take_measurements", "fail"]}


def public() -> Iterator[tuple[str, object]]:
    """Yield every public name with its object: functions, classes and their methods."""
    documented = {name.partition("(")[0] for row in guide.table("name", "does") for name in guide.names(row[0])}
    for name in (*sorted(documented.intersection(vibro_ros.__all__)), *vibro_lab.__all__):
        value = getattr(vibro_ros if name in documented else vibro_lab, name)
        yield name, value
        yield from ((f"{name}.{key}", member) for key, member in vars(value).items()
                    if not key.startswith("_") and key in USED.get(name, [key])
                    and (inspect.isfunction(member) or isinstance(member, property)))


PUBLIC = dict(public())


def examples(name: str) -> list[doctest.Example]:
    return doctest.DocTestParser().get_examples(inspect.getdoc(PUBLIC[name]) or "")


def test_the_interface_is_looked_at():
    assert {"Scene.with_parameters", "Scene.describe", "Simulator.command", "Simulator.state"} <= set(PUBLIC)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_name_has_an_example_that_is_true(name, record_run, tmp_path, monkeypatch):
    if name == "read_bag":
        record_run().rename(tmp_path / "vibro_robot_2026_11_21-10_29_21")
    if name == "identify":
        monkeypatch.syspath_prepend(Path(__file__).parents[1] / "identification")
        import_module("test_identify").bag(tmp_path / "laboratory_bag")
    monkeypatch.chdir(tmp_path)
    assert examples(name)
    test = doctest.DocTest(examples(name), {"vibro_lab": vibro_lab, "vibro_ros": vibro_ros}, name, None, None, None)
    output: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=output.append)
    assert not output, "".join(output)

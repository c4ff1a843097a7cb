"""Each name of the public Python interface has an example, and its output is right."""

import doctest
import inspect

import pytest
from known_recording import known_run, record_run  # noqa: F401 (fixtures)

import vibro_ros
from tools.api_page import public

PUBLIC = dict(public())


def examples(name: str) -> list[doctest.Example]:
    return doctest.DocTestParser().get_examples(inspect.getdoc(PUBLIC[name]) or "")


def test_the_interface_is_looked_at():
    assert {"Scene.with_parameters", "Scene.describe", "Simulator.command", "Simulator.state"} <= set(PUBLIC)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_name_has_an_example_that_is_true(name, record_run, tmp_path, monkeypatch):  # noqa: F811
    if name == "read_bag":
        record_run().rename(tmp_path / "vibro_robot_2026_11_21-10_29_21")
    monkeypatch.chdir(tmp_path)
    assert examples(name)
    test = doctest.DocTest(examples(name), {"vibro_ros": vibro_ros}, name, None, None, None)
    said: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append)
    assert not said, "".join(said)

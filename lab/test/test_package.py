"""The lab as a package: its executables in the device's frame, and what is no scene."""

from importlib import import_module
from importlib.metadata import entry_points

import pytest

import vibro_lab
import vibro_ros
from vibro_lab.executables import EXECUTABLES


@pytest.mark.parametrize("call", [vibro_lab.find_orbit, vibro_lab.settled_motion])
def test_a_name_in_place_of_a_scene_is_refused_with_the_remedy(call):
    with pytest.raises(TypeError, match=r"^scene: 'device' is no Scene; give load_scene\('device'\)$"):
        call("device")
    with pytest.raises(TypeError, match=r"^scene: \{.*\} is no Scene; give one that load_scene returns$"):
        call({"motor.speed": 100.0})  # which cannot be hashed


def test_every_console_script_enters_by_the_frame_of_the_device():
    scripts = [script for script in entry_points(group="console_scripts") if script.value.startswith("vibro_lab.")]
    assert {script.name for script in scripts} == EXECUTABLES.keys()
    for script in scripts:
        assert script.value == f"vibro_lab.executables:{script.name}"
        entrance = script.load()
        assert (entrance.func, entrance.args) == (vibro_ros.enter, (script.name, EXECUTABLES))


@pytest.mark.parametrize("name", EXECUTABLES)
def test_its_help_begins_with_the_sentence_of_the_list(capsys, name):
    does = EXECUTABLES[name].does
    assert does.endswith(".") and len(does) < 100  # one line of a terminal
    with pytest.raises(SystemExit) as ended:
        import_module(EXECUTABLES[name].module).main(["--help"])
    assert not ended.value.code and does in " ".join(capsys.readouterr().out.split())

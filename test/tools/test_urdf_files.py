"""The shipped URDF files are those of the shipped scenes."""

from pathlib import Path

import pytest

from tools.urdf_files import main
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.messages.urdf import robot_description

ROOT = Path(__file__).resolve().parents[2]


def test_each_shipped_scene_has_its_file():
    files = sorted(file.name for file in (ROOT / "config" / "urdf").iterdir())
    assert files == [f"{name}.urdf" for name in shipped_scenes()]


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_file_is_what_make_docs_writes(name):
    shipped = (ROOT / "config" / "urdf" / f"{name}.urdf").read_text(encoding="utf-8")
    assert shipped == robot_description(load_scene(name)), "run `make documents`"


def test_any_scene_is_written_to_the_given_path(tmp_path, capsys):
    scene = tmp_path / "steep.yaml"
    scene.write_text("/**:\n  ros__parameters:\n    guide.angle: 1.4\n")
    assert main([str(scene), "--output", str(tmp_path / "new")]) == 0
    assert (tmp_path / "new" / "steep.urdf").read_text() == robot_description(load_scene(scene))

"""`~` is the home folder in every path of a user: in a function's argument, a command line, a file, a parameter."""

import json
import shutil
import signal
from pathlib import Path

import pytest
from known_recording import known_run  # noqa: F401
from real_processes import start  # noqa: F401

import vibro_ros
from vibro_ros.configuration.scene_file import FOLDERS, config_folder, find_file
from vibro_ros.process.entry_point import Parser
from vibro_ros.process.files import user_path
from vibro_ros.recordings import report
from vibro_ros.recordings.recover import recover
from vibro_ros.recordings.report import write_report
from vibro_ros.view.view import write_page

SCENE = "/**:\n  ros__parameters:\n    scene: ~/base.yaml\n    gravity: 1.5\n"
BASE = "/**:\n  ros__parameters:\n    scene: rigid\n    guide.angle: 1.25\n"


@pytest.fixture
def home(tmp_path_factory, monkeypatch) -> Path:
    """A home folder, which is not the current one, with two scenes, one of which refers to the other."""
    folder = tmp_path_factory.mktemp("home")
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    (folder / "robot.yaml").write_text(SCENE)
    (folder / "base.yaml").write_text(BASE)
    return folder


def test_only_the_beginning_of_a_path_is_a_home_folder(home):
    assert user_path("~/a b") == home / "a b" and user_path(Path("~")) == home
    for other in ("a/~/b", "./~", "~nobody-has-this-name/x", "", "a~"):
        assert user_path(other) == Path(other)


def test_scenes_and_all_other_configuration(home):
    scene = vibro_ros.load_scene("~/robot.yaml")
    assert (scene["gravity"], scene["guide.angle"], scene["effects.upper_contact"]) == (1.5, 1.25, "restitution")
    for kind, (folder, suffix) in FOLDERS.items():
        shipped = sorted((config_folder() / folder).glob(f"*{suffix}"))[0]
        shutil.copy(shipped, home / f"mine{suffix}")
        assert find_file(kind, f"~/mine{suffix}", Path("relative")) == home / f"mine{suffix}"


def test_recordings_and_what_is_written_about_them(home, known_run):  # noqa: F811
    shutil.copytree(known_run(), home / "run")
    assert vibro_ros.read_bag("~/run").duration == 4.0
    assert not recover("~/run").cut
    assert {file.parent for file in write_report("~/run", "~/made")[1]} == {home / "made"}
    assert write_page("~/run", "~/page.html") == home / "page.html"
    assert report.main(["~/run", "--output=~/asked"]) == 0 and (home / "asked" / "report.png").is_file()
    parser = Parser(prog="any")
    parser.add_argument("--output", type=Path)
    assert parser.parse_args(["--output=~/x"]).output == home / "x"


@pytest.mark.process
def test_parameters_and_files_of_a_node(home, start):  # noqa: F811
    (home / "given.yaml").write_text("/**:\n  ros__parameters:\n    record.directory: ~/bags\n")
    robot = start("robot", "--ros-args", "--params-file", "~/given.yaml", "-p", "scene:=~/robot.yaml")
    robot.wait_for(f"recording to {home}/bags/")
    robot.send(signal.SIGTERM)
    assert robot.end() == 0, robot.text
    [bag] = (home / "bags").iterdir()
    assert json.loads(vibro_ros.read_bag(bag).metadata["parameters"])["guide.angle"] == 1.25

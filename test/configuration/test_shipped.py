"""The shipped files are found from a checkout, an installation and a workspace."""

import shutil
from pathlib import Path

import pytest

from vibro_ros.configuration import scene_file


@pytest.fixture
def installed_at(tmp_path, monkeypatch):
    """Return a function that pretends the package was installed into a folder of `tmp_path`."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)

    def install(folder: str) -> None:
        file = tmp_path / folder / "vibro_ros" / "configuration" / "scene_file.py"
        file.parent.mkdir(parents=True)
        shutil.copy(scene_file.__file__, file)
        monkeypatch.setattr(scene_file, "__file__", str(file))

    return install


def make_config(prefix: Path) -> Path:
    """Make an empty config folder below an installation prefix and return it."""
    folder = prefix / "share" / "vibro_ros" / "config"
    folder.mkdir(parents=True)
    return folder


def test_checkout_uses_its_own_config(tmp_path, installed_at):
    installed_at("checkout")
    make_config(tmp_path)
    (tmp_path / "checkout" / "package.xml").touch()
    config = tmp_path / "checkout" / "config"
    config.mkdir()
    assert scene_file.config_folder() == config


@pytest.mark.parametrize("folder", ["lib/python3.12/site-packages", "local/lib/python3.12/dist-packages"])
def test_installation_uses_its_prefix(tmp_path, installed_at, folder):
    installed_at(folder)
    (tmp_path / folder / "config").mkdir()  # another package's
    config = make_config(tmp_path)
    assert scene_file.config_folder() == config


def test_ament_prefix_is_the_last_resort(tmp_path, installed_at, monkeypatch):
    installed_at("elsewhere")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'missing'}:{tmp_path / 'underlay'}")
    config = make_config(tmp_path / "underlay")
    assert scene_file.config_folder() == config


def test_missing_config_says_where_it_looked(tmp_path, installed_at):
    installed_at("lib/python3.12/site-packages")
    with pytest.raises(FileNotFoundError) as error:
        scene_file.config_folder()
    assert str(tmp_path / "share" / "vibro_ros" / "config") in str(error.value)
    assert "\n" not in str(error.value)

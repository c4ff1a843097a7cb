"""The user's settings of matplotlib end no program of the lab, and change none of its pictures."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

LAB = Path(__file__).resolve().parents[2] / "vibro_lab"
RENDER = """
import hashlib, gymnasium, vibro_lab.gym
env = gymnasium.make("vibro_lab/Crawl-v1", render_mode="rgb_array")
env.reset(seed=0)
print(hashlib.sha256(env.render().tobytes()).hexdigest())
"""


def run(*words: str, folder: Path, **environment: str) -> str:
    """Run Python in a folder; returns what it printed."""
    ended = subprocess.run([sys.executable, *words], cwd=folder, env={**os.environ, **environment}, text=True,
                           capture_output=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> str:
    return run("-c", RENDER, folder=tmp_path_factory.mktemp("plain"))


@pytest.mark.process
@pytest.mark.parametrize(("settings", "environment"), [
    (b"", {"MPLBACKEND": "module://matplotlib_inline.backend_inline"}),
    (b"axes.facecolor: black\nfigure.dpi: 900\n", {}),
    (b"\xff\xfe is not UTF-8", {})], ids=["backend", "style", "undecodable"])
def test_settings_of_the_user_change_no_byte_and_end_nothing(plain, tmp_path, settings, environment):
    (tmp_path / "matplotlibrc").write_bytes(settings)
    assert run("-c", RENDER, folder=tmp_path, **environment) == plain
    for words in (("vibro_lab.accuracy.accuracy",), ("vibro_lab.study.command", "sweep")):
        assert "usage: " in run("-m", *words, "--help", folder=tmp_path, **environment)


def test_one_module_imports_matplotlib():
    importers = {path.relative_to(LAB).as_posix() for path in LAB.rglob("*.py")
                 if "from matplotlib" in (text := path.read_text(encoding="utf-8")) or "import matplotlib" in text}
    assert importers == {"study/figures.py"}

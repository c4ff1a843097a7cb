"""`make lint` finds the slips that ruff does not look for."""

import subprocess
import sys
from pathlib import Path

import pytest

from vibro_ros.project import lint, term_slips

MAKEFILE = Path(__file__).resolve().parents[2] / "Makefile"
OUTPUTS = """class Outputs:
    \"\"\"The robot's publishers.

    Attributes
    ----------
    rate : float
        {unit}
    times : ndarray{shape}
        Instants [s].
    \"\"\"

    def publish(self):
        self.topics = {{}}
"""
PAGE = """# The page

`ros/outputs.py:Outputs.publish` uses `Outputs.topics`, see [the other page](docs/other.md#a-second-heading-word).
`make bench` and `.venv/bin/robot --ros-args -p guide.angle:=1.0 -p wait:=2.0`, `guide.angle`, `vibro_ros.ros.outputs`:

    ros2 run vibro_ros robot
    ros2 topic echo /r1/odom
    .venv/bin/python -m vibro_ros.project.bench
    .venv/bin/controller crawl
    .venv/bin/replay bag --set guide.angle=1.2

`test_outputs.py::test_all_is_told` holds `docs/other.md`. Save this as `own.py` and run `.venv/bin/python own.py`.
"""


@pytest.fixture
def repository(tmp_path):
    """A small repository without a slip."""
    sources = {"README.md": PAGE, "docs/other.md": "# Other\n\n## A second heading: `word`\n\n[there](../README.md)\n",
               "Makefile": "bench: ready  ## docs/other.md\n", "config/controller/crawl.yaml": "entries: []\n",
               "vibro_ros/ros/outputs.py": OUTPUTS.format(unit="Samples [Hz].", shape=", shape (n,)"),
               "vibro_ros/ros/controller.py": 'Parameter("wait", 0.0)\n',
               "setup.cfg": "# all angel angle args bin guide m make md other own p patience py python venv word\n",
               "test/ros/test_outputs.py": "def test_all_is_told():\n    pass\n"}
    for name, text in sources.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return tmp_path


def slips(folder, capsys):
    """What is said of a repository; the exit code says whether there is something."""
    code, said = lint.main([str(folder)]), capsys.readouterr().out
    assert code == bool(said)
    return said


def test_a_repository_without_a_slip(repository, capsys):
    assert slips(repository, capsys) == ""


@pytest.mark.parametrize(("good", "bad", "said"), [
    ("docs/other.md#a", "docs/another.md#a", "README.md:3: the link docs/another.md#a-second-heading-word leads to"),
    ("-heading-word", "-heading-words", "leads to no heading of docs/other.md"),
    ("Outputs.publish", "Outputs.publishes", "README.md:3: ros/outputs.py has no Outputs.publishes"),
    ("ros/outputs.py:", "ros/output.py:", "there is no ros/output.py"),
    ("`Outputs.topics`", "`Outputs.topic`", "there is no Outputs.topic"),
    ("make bench", "make bench-all", "bench-all is no make target"),
    ("bin/robot", "bin/bench", "bench is no installed executable"),
    ("-p guide.angle", "-p guide.angel", "guide.angel is no parameter"),
    ("-p wait", "-p patience", "patience is no parameter"),
    ("`guide.angle`", "`guide.angel`", "README.md:4: there is no guide.angel"),
    ("vibro_ros.ros.outputs", "vibro_ros.ros.inputs", "there is no vibro_ros.ros.inputs"),
    ("ros2 run vibro_ros robot", "ros2 run vibro_ros lateness", "README.md:6: lateness is no installed executable"),
    ("/odom", "/odometry", "odometry is no topic"),
    ("project.bench", "project.child", "vibro_ros.project.child is no module that can be run"),
    ("controller crawl", "controller walk", "there is no config/controller/walk.yaml"),
    ("--set guide.angle", "--set guide.angel", "guide.angel is no parameter"),
    ("test_outputs.py::", "test_output.py::", "there is no test test_output.py"),
    ("::test_all_is_told", "::test_all", "test_outputs.py has no test_all"),
    ("`docs/other.md`", "`docs/another.md`", "there is no docs/another.md"),
    ("Save this as `own.py`", "See `own.py`", "there is no own.py"),
    ("`docs/other.md`", "`mottor_speed`", "mottor_speed: no source has this word"),
    ("Save", "Its behavior: save", "README.md:12: behavior: write behaviour"),
])
def test_a_slip_in_a_document_is_found(repository, capsys, good, bad, said):
    assert PAGE.count(good) == 1
    (repository / "README.md").write_text(PAGE.replace(good, bad))
    found = slips(repository, capsys)
    assert said in found
    assert found.count("\n") == 1


@pytest.mark.parametrize(("file", "text", "said"), [
    ("Makefile", "bench: ready  ## docs/interface.md\n", "Makefile: there is no docs/interface.md\n"),
    ("docs/other.md", "## A second heading: `word`\n\n[there](README.md)\n",
     "docs/other.md:3: the link README.md leads to no file\n"),
    ("vibro_ros/ros/outputs.py", OUTPUTS.format(unit="Samples.", shape=", shape (n,)"),
     "vibro_ros/ros/outputs.py:1: Outputs: rate: name the unit, such as `[m/s]`, or write `dimensionless`\n"),
    ("vibro_ros/ros/outputs.py", OUTPUTS.format(unit="Samples [Hz].", shape=""),
     "vibro_ros/ros/outputs.py:1: Outputs: times: name the shape, such as `ndarray, shape (n,)`\n"),
])
def test_a_slip_elsewhere_is_found(repository, capsys, file, text, said):
    (repository / file).write_text(text)
    assert slips(repository, capsys) == said


def test_every_term_has_one_spelling():
    for right in term_slips.TERMS.values():
        assert not term_slips.WRONG.search(right)


def looked_for_marks(folder: Path) -> subprocess.CompletedProcess:
    return subprocess.run(["make", "--no-print-directory", "-f", str(MAKEFILE), "conflict-markers"], cwd=folder,
                          capture_output=True, text=True, timeout=60)


def test_no_merge_has_left_its_marks():
    done = looked_for_marks(MAKEFILE.parent)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("line", ["<" * 7 + " HEAD", "=" * 7, ">" * 7 + " a branch", "|" * 7 + " 1d3b5", "<" * 7])
@pytest.mark.parametrize("name", ["docs/page.md", "code.py", "words", ".hidden/robot.yaml"])
def test_the_marks_of_a_merge_are_found(tmp_path, name, line):
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(f"before\n{line}\nafter\n")
    done = looked_for_marks(tmp_path)
    assert done.returncode != 0
    assert f"{name}:2:{line}" in done.stdout


@pytest.mark.parametrize("line", ["=" * 8, "<" * 8, " " + "<" * 7, "a " + "=" * 7, "<" * 7 + "<!-- a comment -->"])
def test_other_lines_are_none(tmp_path, line):
    (tmp_path / "page.md").write_text(f"{line}\n")
    assert looked_for_marks(tmp_path).returncode == 0


@pytest.mark.parametrize(("command", "name", "text", "said"), [
    ("ruff check", "long.py", "import os\n", "F401"),
    ("codespell_lib", "page.md", "A {}ved command.\n".format("recie"), "ved ==> received"),  # parted for itself
    ("mypy", "typed.py", 'speed: float = "fast"\n', "Incompatible types in assignment"),
])
def test_a_slip_is_found_by_each_library(tmp_path, command, name, text, said):
    (tmp_path / name).write_text(text)
    words = [sys.executable, "-m", *command.split(), str(tmp_path / name)]
    done = subprocess.run(words, cwd=MAKEFILE.parent, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0
    assert said in done.stdout


def test_make_lint_asks_them_all():
    words = ["make", "--dry-run", "lint"]
    done = subprocess.run(words, cwd=MAKEFILE.parent, capture_output=True, text=True, timeout=60)
    for command in ("git grep", "bin/ruff check", "bin/codespell", "project.lint", "bin/mypy"):
        assert command in done.stdout

"""The files that a public forge and an editor read: they name what is there, and their commands work."""

import re
import subprocess
from pathlib import Path

import pytest
import yaml

from vibro_ros.bag.metadata import FILE_NAME, bag_information, write_metadata
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.simulation.provenance import provenance

ROOT = Path(__file__).resolve().parents[2]
FORGE = ROOT / ".github"
WORKFLOW = yaml.safe_load((FORGE / "workflows" / "ci.yaml").read_text())


def test_the_workflow_runs_every_supported_python_and_both_distributions():
    setup = (ROOT / "setup.py").read_text()
    low, below = map(int, re.search(r'python_requires=">=3\.(\d+),<3\.(\d+)"', setup).groups())
    jobs = WORKFLOW["jobs"]
    assert jobs["jazzy"]["strategy"]["matrix"]["python"] == [f"3.{minor}" for minor in range(low, below)]
    steps = {name: [step["run"] for step in job["steps"] if "run" in step] for name, job in jobs.items()}
    assert steps["jazzy"][-1] == ".ci/run" and (ROOT / ".ci" / "run").stat().st_mode & 0o100
    assert steps["kilted"][-1] == "make test ROS=kilted" and (ROOT / "requirements" / "kilted.txt").is_file()


@pytest.mark.parametrize("template", [
    "pull_request_template.md", *sorted(f"ISSUE_TEMPLATE/{path.name}" for path in FORGE.glob("ISSUE_TEMPLATE/*.md"))])
def test_the_command_of_a_template_prints_the_provenance_of_a_bag(template, tmp_path):
    [command] = re.findall(r"^    (sed .*)$", (FORGE / template).read_text(), re.MULTILINE)
    entries = provenance(load_scene("device").parameters, 0)
    write_metadata(tmp_path / FILE_NAME, bag_information([], [], entries))
    printed = subprocess.run(command.replace("BAG_FOLDER", str(tmp_path)), shell=True, check=True, text=True,
                             capture_output=True).stdout
    assert yaml.safe_load(printed)["custom_data"] == entries

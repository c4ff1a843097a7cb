"""The changelog has an entry for the package's version, and states for each version whether bits changed."""

import re
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import yaml

ROOT = Path(__file__).resolve().parents[2]
CHANGELOG = (ROOT / "CHANGELOG.md").read_text()
ENTRIES = re.findall(r"^## (\S+)(?: \([\d-]+\))?\n(.*?)(?=^## |\Z)", CHANGELOG, re.MULTILINE | re.DOTALL)
PACKAGE = ElementTree.parse(ROOT / "package.xml").getroot()


def test_the_top_entry_is_the_packages_version():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert ENTRIES[0][0] == PACKAGE.findtext("version") == version("vibro_ros") == cited["version"]
    assert f"## {cited['version']} ({cited['date-released']})\n" in CHANGELOG
    assert cited["license"] == PACKAGE.findtext("license")
    interfaces = ElementTree.parse(ROOT / "interfaces" / "vibro_ros_interfaces" / "package.xml").getroot()
    assert interfaces.findtext("version") == PACKAGE.findtext("version")


def test_versions_descend_and_each_states_whether_bits_changed():
    numbers = [tuple(map(int, name.split("."))) for name, _ in ENTRIES]
    assert len(numbers) > 1 and numbers == sorted(set(numbers), reverse=True)
    for name, text in ENTRIES:
        assert re.search(r"^\*\*Bits:\*\* \w", text, re.MULTILINE), name

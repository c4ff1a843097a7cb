"""The contents of README and docs are right: their Python runs, and their tables are those of the code. `make lint`
checks names and links.
"""

import contextlib
import dataclasses
import io
import re
from importlib import import_module
from pathlib import Path

import guide
import pytest
import yaml

import vibro_lab
import vibro_ros
from tools import documents, effects, parameter_table, topic_table
from tools.generated_text import replaced
from vibro_lab.executables import EXECUTABLES as OF_THE_LAB
from vibro_lab.study.measures import MEASURES
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.frames import JOINTS
from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.messages.urdf import COMMANDED
from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.ros.controller.script import read_script
from vibro_ros.simulation.readout import EventLog
from vibro_ros.simulation.samples import Samples

MODULES = {name: executable.module for name, executable in (*OF_THE_LAB.items(), *EXECUTABLES.items())}
INSTALLED = {*OF_THE_LAB, *(name for name, executable in EXECUTABLES.items() if executable.installed)}
OTHER_STATISTICS = ("steps", "solver.method", "solver.step")
ROOT = Path(__file__).resolve().parents[3]
DOCUMENTS = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *ROOT.glob("docs/**/*.md"))}
FENCE = re.compile(r"^```(\w+)\n(.*?)^```\n(?:```text\n(.*?)^```\n)?", re.MULTILINE | re.DOTALL)
BLOCKS = [(name, language, text, output) for name, document in DOCUMENTS.items()
          for language, text, output in FENCE.findall(document)
          if name != "begin.md" or language == "console"]  # its ten minutes are one whole, see test_tutorial.py


def blocks(language):
    """Return each fenced block of a language, with the output shown below it, as test parameters."""
    shown = [(text, output) for _, of, text, output in BLOCKS if of == language]
    names = [f"{name}-{k}" for k, name in enumerate(name for name, of, _, _ in BLOCKS if of == language)]
    assert shown
    return pytest.mark.parametrize(("text", "output"), shown, ids=names)


def test_the_pages_are_few_and_the_first_one_is_short():
    """Pages in the site's menu, tables behind a page aside; README's limits are lines and words."""
    readme = DOCUMENTS["README.md"]
    assert len(readme.splitlines()) <= 90 and len(readme.split()) <= 800
    menu = (ROOT / "tools" / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    pages = {str(path.relative_to(ROOT / "docs")) for path in ROOT.glob("docs/**/*.md")}
    assert len(pages & set(re.findall(r"[\w/]+\.md", menu))) <= 22


@blocks("python")
def test_python_runs_and_prints_what_is_shown(text, output, tmp_path, monkeypatch, record_run):
    record_run("out/vibro_robot_2026_01_02-03_04_05")
    (tmp_path / "out" / "vibro_robot_2026_01_02-03_04_05_report").mkdir()
    monkeypatch.chdir(tmp_path)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(text, {})
    assert printed.getvalue()
    assert output in ("", printed.getvalue())


@blocks("yaml")
def test_yaml_is_a_script_or_a_scene(text, output, tmp_path):
    file = tmp_path / "file.yaml"
    file.write_text(text)
    if "entries" in yaml.safe_load(text):
        assert read_script(file).duration > 0.0
    elif "controller_manager" in yaml.safe_load(text):
        loaded = yaml.safe_load(text).values()
        joints = [joint for node in loaded for joint in node["ros__parameters"].get("joints", ())]
        assert sorted(joints) == sorted(COMMANDED)
    else:
        assert load_scene(file).parameters != load_scene("paper").parameters


@pytest.mark.parametrize("line", [line for _, language, text, _ in BLOCKS if language == "console"
                                  for line in text.splitlines()])
def test_errors_are_the_ones_shown(line, tmp_path, domain_id, monkeypatch, capsys):
    """Each error that is shown is the message that the command prints."""
    (tmp_path / "bad.yaml").write_text("entries:\n  - for: 1.0\n    motor_speed: -600\n")
    (tmp_path / "forwards.yaml").write_text("entries: [{hold_speed: 0.05, for: 10.0}]\n")
    (tmp_path / "itself.yaml").write_text("/**:\n  ros__parameters:\n    scene: itself.yaml\n")
    (tmp_path / "other.yaml").write_text("vibro_robt:\n  ros__parameters:\n    gravity: 9.81\n")
    words = {"guide.angel": "ros.robot.robot --ros-args -p guide.angel:=1.0",
             "bad.yaml": "ros.controller.controller bad.yaml",
             "forwards.yaml": "ros.controller.controller forwards.yaml",
             "mass.body": "ros.robot.robot --ros-args -p mass.body:=0.0", "/tmp/nobag": "recordings.report /tmp/nobag",
             "/tmp/none": "recordings.recover /tmp/none", "/tmp/norun": "recordings.replay /tmp/norun",
             "papper": "ros.robot.robot --ros-args -p scene:=papper",
             "itself.yaml": "accuracy.accuracy --scene itself.yaml",
             "other.yaml": "ros.robot.robot --ros-args --params-file other.yaml"}[line.split(": ")[1]].split()
    monkeypatch.chdir(tmp_path)
    assert import_module(f"vibro_ros.{words[0]}").main(words[1:]) == 2
    assert capsys.readouterr().err == f"{line}\n"


def test_choices_of_every_effect_are_in_the_model():
    rows = re.findall(r"^\| (`effects[^|]*) \| ([^|]*) \|", DOCUMENTS["robot.md"], re.MULTILINE)
    documented = {name: set(re.findall(r"`([\w.]+)`", choices)) for names, choices in rows
            for name in re.findall(r"`([\w.]+)`", names)}
    real = {parameter.name: set(parameter.choices) or {"true", "false"} for parameter in SCENE_PARAMETERS
            if parameter.name.startswith("effects.")}
    assert documented == real


def test_joints_and_fields_of_a_run_are_complete():
    assert guide.first_column("joint", "position", "velocity", "effort") == list(JOINTS)
    fields = [name for row in guide.table("field", "unit", "meaning") for name in guide.names(row[0])]
    assert sorted(fields) == sorted(field.name for field in dataclasses.fields(Samples))


def test_kinds_of_events_are_those_that_a_device_can_have():
    kinds = {str(kind) for kind in EventLog(("upper", "inclined"))._kinds}
    assert sorted(guide.first_column("kind", "when")) == sorted(kinds - {""})
    passage = guide.PAGES["python.md"].partition("`Run.statistics` and `Simulator.statistics`")[2].partition("\n\n")[0]
    documented = {name for name in guide.names(passage) if "." not in name or name.startswith("solver.")}
    assert documented - {"exact", "solver.accounts"} == {*OTHER_STATISTICS, "energy_accounts", "wall_time"}


def test_accounts_are_those_of_a_run():
    booked = load_scene("damped").with_parameters({"solver.accounts": True})
    accounts = vibro_ros.simulate(booked, duration=0.1, rate=10.0).statistics["energy_accounts"]
    assert sorted(guide.first_column("account", "meaning")) == sorted(accounts)


def test_the_public_names_are_all_told():
    documented = {name.partition("(")[0] for row in guide.table("name", "does") for name in guide.names(row[0])}
    further = guide.first_column("names of `vibro_ros`", "for")
    explained = {name for name in documented if "." not in name and "[" not in name}
    assert sorted(explained | {*further}) == sorted(vibro_ros.__all__)
    of_lab = [name.partition("(")[0] for name in guide.first_column("name of `vibro_lab`", "does")]
    assert sorted(of_lab) == sorted(vibro_lab.__all__)
    for name in documented - set(vibro_ros.__all__):
        owner, attribute = load_scene("paper"), name.partition(".")[2].partition("[")[0]
        assert "[" in name or hasattr(owner, attribute), name
    [row] = [row for row in guide.table("name", "does") if row[0] == "`Simulator(scene)`"]
    device = vibro_ros.Simulator(load_scene("paper"))
    for name in guide.names(row[1]):
        assert hasattr(device, name.partition("(")[0]), name


def test_measures_are_those_of_the_studies():
    rows = {guide.names(name)[0]: (unit, meaning) for name, unit, meaning in guide.table("measure", "unit", "meaning")}
    assert rows == {name: (measure.unit, measure.meaning) for name, measure in MEASURES.items()}


def test_keys_of_a_script_are_those_that_are_read(tmp_path):
    keys = guide.first_column("key of an entry", "meaning")
    assert sorted(keys) == sorted(["for", "at", *COMMAND_UNITS, "note", "fault", "of", "value", "from_x", "to_x",
                                   "entries", "repeat"])
    file = tmp_path / "script.yaml"
    file.write_text("repeat: 2\nentries:\n  - {note: a, at: 0.0, for: 1.0, motor_speed: 5.0, upper_gap: 0.0, "
                    "inclined_gap: {from: 0.0, to: 0.001}}\n  - {note: b, at: 1.0, repeat: 2, entries: [{for: 1.0}]}\n")
    assert read_script(file).duration == 6.0


def codes(text):
    """Exit codes of a list such as `0 done; 1 not done; 130, 143 stopped`, with or without colons."""
    starts = [re.match(r"[\d, ]*", part.strip())[0] for part in text.split(";")]
    return {int(code) for start in starts for code in start.replace(",", " ").split()}


def test_executables_and_their_exit_codes_are_those_of_their_help(capsys):
    rows = {name: cells for *cells, name in ((row[2], guide.names(row[0])[0]) for row in guide.table(
        "executable", "does", "exit codes"))}
    assert {name.split()[0] for name in rows} == INSTALLED
    for name, [documented] in rows.items():
        with pytest.raises(SystemExit) as ended:
            import_module(MODULES[name.split()[0]]).main(["--help"])
        help_text = " ".join(capsys.readouterr().out.partition("Exit code")[2].split())
        assert not ended.value.code and codes(help_text) == codes(documented), (name, help_text, documented)


def test_parameter_table_is_up_to_date():
    text, marks = DOCUMENTS["parameters.md"], (parameter_table.BEGIN, parameter_table.END)
    assert replaced(text, *marks, parameter_table.parameter_table()) == text, "run `make documents`"


def test_topic_table_is_up_to_date():
    text, marks = DOCUMENTS["node.md"], (topic_table.BEGIN, topic_table.END)
    assert replaced(text, *marks, topic_table.topic_table()) == text, "run `make documents`"


def test_a_document_without_a_place_for_the_table_is_refused(tmp_path):
    file = tmp_path / "page.md"
    for text in ("no place", f"{parameter_table.END}\n{parameter_table.BEGIN}\n", f"{parameter_table.BEGIN}\n" * 2):
        file.write_text(text)
        with pytest.raises(ValueError, match="the table's place is not marked"):
            parameter_table.main([str(file)])
        assert file.read_text() == text


def test_a_page_carries_the_fingerprint_of_its_sources():
    page = documents.marked("# A page\n", "effects", "0123")
    assert documents.stored_fingerprint(page, "effects") == "0123" and documents.stored_fingerprint(page, "map") == ""
    assert documents.stored_fingerprint(documents.marked(page, "effects", "4567"), "effects") == "4567"
    assert documents.without_marks(documents.marked(page, "map", "89")) == "# A page\n"
    for document in documents.DOCUMENTS.values():
        assert (ROOT / document.page).is_file()
        begins = [place for number in document.numbers for place in documents._begins(number)]
        assert all(name in documents.module_of(module).definitions for module, name in begins), document.numbers
        assert bool(begins) == document.measured


HELPER = "def factor(x):\n    return 2.0 * x\n"


@pytest.mark.parametrize(("file", "text", "changes"), [
    ("made.py", '"""Z."""\n# c\nfrom tools.helper import factor\n\n\ndef table(length: float) -> float:\n'
                '    """Y."""\n    return factor(length)  # d\n', False),
    ("helper.py", f'"""W."""\n{HELPER}\n\ndef of_another_page():\n    return 3\n', False),
    ("made.py", "from tools.helper import factor\n\n\ndef table(x):\n    return factor(x) + 1.0\n", True),
    ("helper.py", HELPER.replace("2.0", "3.0"), True),
    ("digests.json", '{"scene/device/exact": "1", "scene/other/exact": "9"}', False),
    ("digests.json", '{"scene/device/exact": "7"}', True)], ids=[
        "words", "another page's function", "a statement", "a statement of a helper", "other bits", "bits"])
def test_a_page_is_stale_if_what_decides_its_numbers_changes_alone(file, text, changes, tmp_path, monkeypatch):
    """A comment, or a function for another page, makes no page stale."""
    (tmp_path / "made.py").write_text("from tools.helper import factor\n\n\ndef table(x):\n    return factor(x)\n")
    (tmp_path / "helper.py").write_text(HELPER)
    (tmp_path / "digests.json").write_text('{"scene/device/exact": "1"}')
    monkeypatch.setattr(documents, "PACKAGES", {"tools": tmp_path})
    monkeypatch.setattr(documents, "DIGESTS", tmp_path / "digests.json")
    monkeypatch.setattr(documents, "module_of", documents.module_of.__wrapped__)
    document = documents.Document("page.md", (), 1.0, ("tools.made:table",), ("scene/device/exact",))
    earlier = documents.fingerprint(document)
    (tmp_path / file).write_text(text)
    assert (documents.fingerprint(document) != earlier) == changes


@pytest.mark.parametrize(("names", "code"), [([], 0), (["map", "paper"], 1)])
def test_a_stale_page_fails_the_check(names, code, monkeypatch, capsys):
    """By its exit code `make lint` fails."""
    monkeypatch.setattr(documents, "stale", lambda: names)
    assert documents.main(["--check"]) == code
    output = capsys.readouterr().out
    assert [name for name in documents.DOCUMENTS if f"ONLY={name}`" in output] == names


def test_a_fingerprint_reaches_modules_that_a_generator_takes_as_values():
    """The machines of the literature stand in a tuple of modules, and studies beside each other share functions."""
    reached = documents.reached(documents.DOCUMENTS["literature"].numbers)
    assert {"research.literature.capsule", "vibro_lab.orbits.recurrence"} <= {module for module, _ in reached}
    assert not any(module.startswith("vibro_ros") for module, _ in reached)


def test_effects_tables_have_every_effect_and_count_what_is_compiled():
    """Costs and motions are measured and not compared; the numbers of states, modes, terms and guards are."""
    text = DOCUMENTS["robot.md"].partition(effects.BEGIN)[2].partition(effects.END)[0]
    tables = dict(re.findall(r"^The scene `(\w+)` (.*?)(?=\nThe scene|\Z)", text, re.MULTILINE | re.DOTALL))
    assert list(tables) == list(dict.fromkeys(effect.scene for effect in effects.EFFECTS)), "run `make documents`"
    for name, table in tables.items():
        lines = table.strip().splitlines()
        assert lines[2] == f"| {' | '.join(effects.HEADS)} |"
        counts = [line.removeprefix("| ").split(" | ")[:5] for line in lines[4:]]
        assert counts == [effects.counted(effect) for effect in effects.EFFECTS if effect.scene == name]
        whole = effects.size(load_scene(name))
        numbers = f"{whole.states} states, {whole.modes} modes, at most {whole.terms} terms and {whole.guards} guards"
        assert numbers in lines[0]

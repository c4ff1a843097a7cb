"""`study literature`: its words, its files, interruptions and bad visitors; docs/literature.md against the code."""

import re
from pathlib import Path

import pytest

from research.literature import command as literature
from research.literature import report as literature_report
from research.literature import two_phase_finding
from research.literature.command import main
from research.literature.published import OUTSIDE, VERDICTS, Check, Claim, Finding, Mapped, Studied

DOCS = Path(__file__).resolve().parents[3] / "docs"
FINDINGS = literature.read_findings(DOCS / literature_report.FOLDER / literature.DATA)
ONE = Finding("one", "One", ("A source",), "Contained.", (Mapped("a", "b", "c"),), (Check("what", 1.0, 2.0),),
              (Claim("said", "found", OUTSIDE, "rule"),), "nothing.")


class Picture:
    def savefig(self, path, dpi):
        path.write_bytes(b"")


@pytest.fixture
def quick_studies(monkeypatch):
    monkeypatch.setattr(literature, "PUBLISHED", {"one": lambda quick: Studied(ONE, Picture),
                                                  "two": lambda quick: Studied(ONE, Picture)})


def test_the_document_is_what_the_findings_say():
    assert (DOCS / literature.TEXT).read_text(encoding="utf-8") == literature_report.report(FINDINGS)


def test_the_document_has_every_study_a_passed_check_each_and_known_verdicts():
    assert [finding.name for finding in FINDINGS] == list(literature.PUBLISHED)
    for finding in FINDINGS:
        assert finding.checks and all(check.passed for check in finding.checks)
        assert {claim.verdict for claim in finding.claims} <= set(VERDICTS)
        assert (DOCS / literature_report.FOLDER / literature.picture_name(finding.name)).is_file()


def test_a_short_study_finds_what_the_document_says():
    """The quick run has fewer scenes; statements and verdicts of this study must not depend on them."""
    stored = next(finding for finding in FINDINGS if finding.name == two_phase_finding.NAME)
    quick = two_phase_finding.study(True).finding
    assert [(claim.statement, claim.verdict) for claim in quick.claims] == \
        [(claim.statement, claim.verdict) for claim in stored.claims]
    assert quick.mapping == stored.mapping and quick.sources == stored.sources


def test_what_is_written_can_be_read_again(tmp_path):
    literature.write_findings([ONE], tmp_path / "findings.json")
    assert literature.read_findings(tmp_path / "findings.json") == [ONE]


def test_the_executable_prints_and_writes(quick_studies, tmp_path, capsys):
    assert main(["literature", "--output", str(tmp_path / "new")]) == 0
    text = (tmp_path / "new" / literature.TEXT).read_text(encoding="utf-8")
    assert "**not contained**" in text and "Not complete" not in text
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / "new" / literature.TEXT)


def test_the_named_study_alone_is_run(quick_studies, tmp_path):
    assert main(["literature", "two", "--quick", "--output", str(tmp_path)]) == 0
    assert [path.name for path in sorted(tmp_path.glob("*.png"))] == ["two.png"]


def test_an_interruption_keeps_what_is_done(monkeypatch, tmp_path, capsys):
    def interrupted(quick):
        raise KeyboardInterrupt
    monkeypatch.setattr(literature, "PUBLISHED", {"one": lambda quick: Studied(ONE, Picture), "two": interrupted})
    assert main(["literature", "--output", str(tmp_path)]) == 130
    assert "1 of 2 studies" in (tmp_path / literature.TEXT).read_text(encoding="utf-8")
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("words", [["nonsense"], [""], ["--quick=yes"], ["--output", "/proc/none"]])
def test_bad_words_are_refused_in_one_line(words, capsys):
    assert main(["literature", *words]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and said.startswith("study literature: ")


def test_a_study_that_fails_is_one_line(monkeypatch, tmp_path, capsys):
    def failing(quick):
        raise RuntimeError("the capsule at 3: no step")
    monkeypatch.setattr(literature, "PUBLISHED", {"one": lambda quick: Studied(ONE, Picture), "two": failing})
    assert main(["literature", "--output", str(tmp_path)]) == 1
    assert re.fullmatch("study literature: the capsule at 3: no step; 1 of 2 studies are kept\n",
                        capsys.readouterr().err)
    assert literature.read_findings(tmp_path / literature.DATA) == [ONE]

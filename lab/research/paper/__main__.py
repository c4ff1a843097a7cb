"""All figures and claims of the paper, under each reading of its text: `make paper`, or a short version with `--quick`.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from research.paper.page import SHOWN, draw_reading, page
from research.paper.runs import Single, full_effort, judged, quick_effort, read_verdicts, single_runs, write_verdicts

FOLDER, VERDICTS, SINGLES, TEXT = "paper", "verdicts.csv", "single_runs.json", "paper.md"


def main(words: Sequence[str]) -> int:
    """Run the study and write the page; returns 0, 1 for a failure, 2 for bad input, or 130 if interrupted."""
    parser = argparse.ArgumentParser(prog="python -m research.paper", description=__doc__)
    parser.add_argument("--output", type=Path, metavar="DIR",
                        help="where the page goes (default: docs; with --quick out/study/paper)")
    parser.add_argument("--quick", action="store_true", help="few starts, Runge-Kutta of one step: two minutes")
    options = parser.parse_args(words)
    docs = options.output or Path("out/study/paper" if options.quick else "docs")
    effort = quick_effort() if options.quick else full_effort()
    (docs / FOLDER).mkdir(parents=True, exist_ok=True)
    try:
        write_verdicts(docs / FOLDER / VERDICTS, judged(effort))
        for reading in SHOWN:
            draw_reading(reading, docs / FOLDER)
        judgements = read_verdicts(docs / FOLDER / VERDICTS)
        singles = [single._asdict() for single in single_runs(judgements)]
        (docs / FOLDER / SINGLES).write_text(json.dumps(singles, indent=1) + "\n", encoding="utf-8")
        text = page(judgements, read_singles(docs / FOLDER / SINGLES), effort, FOLDER)
    except KeyboardInterrupt:
        print("paper: interrupted", file=sys.stderr)
        return 130
    except (ValueError, RuntimeError, OSError) as error:
        print(f"paper: {error}", file=sys.stderr)
        return 2 if isinstance(error, ValueError) else 1
    (docs / TEXT).write_text(text, encoding="utf-8")
    print(docs / TEXT)
    return 0


def read_singles(path: Path) -> list[Single]:
    """Read the results of `single_runs` from a file."""
    return [Single(**fields) for fields in json.loads(path.read_text(encoding="utf-8"))]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

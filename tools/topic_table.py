"""Make the table of the robot's topics in docs/guide/node.md, from the program's own table."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tools.generated_text import write_between
from vibro_ros.messages.topics import BAG, COMMAND, TOPICS, full_name

BEGIN = "<!-- topics: written by `make documents` -->"
END = "<!-- end of topics -->"


def topic_table() -> str:
    """Return the table in Markdown, with a row for each topic that is subscribed to or published."""
    rows = [["topic", "direction", "type", "depth", "content"], ["---"] * 5]
    rows += [[f"`{full_name(name)}`", "in" if topic.when == COMMAND else "out", topic.type, str(topic.quality.depth),
              topic.meaning] for name, topic in TOPICS.items() if topic.when != BAG]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--file", type=Path, default=Path("docs/guide/node.md"), help="default: %(default)s")
    file = parser.parse_args(words).file
    write_between(file, BEGIN, END, topic_table)
    print(f"{file}: topics written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Bags whose metadata.yaml another hand was in, or that have links, pipes and folders in the place of files."""

import os
from pathlib import Path

from hostile_files import DEEP, LAUGHS, Maker, flipped, linked, part, torn, without_metadata


def custom(key: str, value: str) -> Maker:
    """Replace a value of the custom data in metadata.yaml."""
    def make(folder: Path) -> None:
        lines = (folder / "metadata.yaml").read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if line.startswith(f"    {key}:"))
        end = next(i for i in range(at + 1, len(lines)) if not lines[i].startswith("      "))
        (folder / "metadata.yaml").write_text("\n".join([*lines[:at], f"    {key}: {value}", *lines[end:]]) + "\n")
    return make


def metadata(text: str | bytes) -> Maker:
    """Replace metadata.yaml."""
    data = text if isinstance(text, bytes) else text.encode()
    return lambda folder: (folder / "metadata.yaml").write_bytes(data) and None


def replaced(old: str, new: str) -> Maker:
    """Replace text in metadata.yaml."""
    def make(folder: Path) -> None:
        text = (folder / "metadata.yaml").read_text()
        assert old in text
        (folder / "metadata.yaml").write_text(text.replace(old, new, 1))
    return make


def piped(name: str) -> Maker:
    """A named pipe in the place of a file."""
    def make(folder: Path) -> None:
        path = part(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        os.mkfifo(path)
    return make


def hard_linked(folder: Path) -> None:
    """The file has another name outside."""
    os.link(part(folder), folder.parent / "outside" / "same")


def foldered(name: str) -> Maker:
    """A folder in the place of a file."""
    def make(folder: Path) -> None:
        path = part(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        (path / "x").mkdir(parents=True)
    return make


OF_METADATA: dict[str, Maker] = {
    **{f"metadata flip {seed}": flipped(seed, "metadata.yaml") for seed in range(16)},
    "metadata of laughs": metadata(LAUGHS),
    "metadata of depth": metadata(DEEP),
    "metadata in themselves": metadata("rosbag2_bagfile_information: &x {version: 9, custom_data: *x}"),
    "metadata of many keys": metadata("".join(f"k{i}: 1\n" for i in range(60_000))),
    "metadata of dates": metadata("rosbag2_bagfile_information: {version: 2001-99-99}"),
    "metadata of maybe": metadata("rosbag2_bagfile_information: !!bool maybe"),
    "metadata of bytes": metadata(b"\xff\xfe" * 1000),
    "metadata of NUL": metadata(b"\0" * 1000),
    "metadata of UTF-16": metadata("a: 1".encode("utf-16")),
    "metadata of size": metadata(b"#" * 2**24),
    "empty metadata": metadata(b""),
    "version 99": replaced("version: 9", "version: 99"),
    "version of text": replaced("version: 9", "version: nine"),
    "names passwd": replaced("- run_0", "- ../../etc/passwd\n  - run_0"),
    "names only passwd": lambda folder: replaced(f"- {part(folder).name}", "- ../../etc/passwd")(folder),
    "names nothing": lambda folder: replaced(f"- {part(folder).name}", "[]")(folder),
    "names it twice": lambda folder: replaced(f"- {part(folder).name}",
                                              f"- {part(folder).name}\n  - {part(folder).name}")(folder),
    "names zero": lambda folder: replaced(f"- {part(folder).name}", "- /dev/zero")(folder),
    "names a number": lambda folder: replaced(f"- {part(folder).name}", "- 5")(folder),
    "wrong count": replaced("message_count: ", "message_count: 9"),
    "negative duration": replaced("nanoseconds: ", "nanoseconds: -"),
    "no duration": replaced("nanoseconds: ", "nanoseconds: .nan #"),
    "compressed": replaced("compression_mode: ''", "compression_mode: message"),
    "parameters of depth": custom("parameters", f"'{'[' * 50_000}'"),
    "parameters of numbers": custom("parameters", "'5'"),
    "parameters of lists": custom("parameters", "'{\"guide.angle\": [1, {}], \"rate.publish\": null}'"),
    "parameters of digits": custom("parameters", f"'{{\"guide.angle\": {'9' * 5000}}}'"),
    "a late start": custom("start", f"'{'9' * 4000}'"),
    "a start of text": custom("start", "'now\x1b[31m'") and custom("start", "now"),
    "topics of depth": custom("topics", f"'{'[' * 50_000}'"),
    "topics of another": custom("topics", "'{\"odom\": \"/motor_power\"}'"),
    "topics of numbers": custom("topics", "'{\"odom\": 5}'"),
    "a scene of lines": custom("scene", '"a\\nb\\e[31m"'),
    "link to metadata": linked("metadata.yaml", "precious"),
    "link to zero as metadata": linked("metadata.yaml", "/dev/zero"),
    "pipe as metadata": piped("metadata.yaml"),
    "folder as metadata": foldered("metadata.yaml"),
    "link as part": linked("part", "precious"),
    "link to zero as part": linked("part", "/dev/zero"),
    "pipe as part": piped("part"),
    "folder as part": foldered("part"),
    "pipe as another part": piped("run_1.mcap"),
    "link as temporary file": without_metadata(linked("metadata.yaml.tmp", "precious")),
    "link as torn": without_metadata(torn(linked("run_0.mcap.torn", "precious"))),
    "link as reserve": without_metadata(linked(".reserve", "precious")),
    "another name outside": without_metadata(torn(hard_linked)),
}

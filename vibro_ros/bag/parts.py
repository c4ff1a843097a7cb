"""Which files a bag folder consists of, and their opening, whatever another hand has put there."""

import errno
import os
import re
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from rosbags.rosbag2.storage_mcap import zstd

from vibro_ros.bag.mcap_part import McapPart
from vibro_ros.bag.mcap_scan import ForeignFileError
from vibro_ros.bag.metadata import FILE_NAME, custom_of, read_metadata
from vibro_ros.bag.part import Part
from vibro_ros.bag.sqlite_part import DatabaseError, SqlitePart
from vibro_ros.process.untrusted import kind_of, open_to_read

STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}
"""What a file's ending says of its format."""

COMPRESSED = ".zstd"
"""Ending of a file that `ros2 bag record --compression-mode file` has compressed."""

LARGEST_UNFOLDED = 2**30
"""Bytes up to which a compressed file is unfolded for reading."""

MOST_ENTRIES = 100_000
"""Files of a folder that are looked at."""

_KINDS = {".mcap": McapPart, ".db3": SqlitePart}
_BLOCK = 2**20  # bytes that are unfolded at a time


@dataclass
class Told:
    """What metadata.yaml says.

    Attributes
    ----------
    information : dict
        All of it; empty when it cannot be understood.
    names : list of str
        The files, as it names them.
    custom : dict of str to str
        The custom data.
    flaws : list of str
        What of it cannot be understood.
    compressed_messages : bool
        Whether each message is compressed by itself.
    """

    information: dict = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    custom: dict[str, str] = field(default_factory=dict)
    flaws: list[str] = field(default_factory=list)
    compressed_messages: bool = False


def told(folder: Path) -> Told:
    """What metadata.yaml of a bag folder says; what it says of topics and times is left to the files themselves."""
    try:
        information = read_metadata(folder)
    except ValueError as error:
        return Told(flaws=[str(error).removeprefix(f"{folder}/").removesuffix("; give the path of a YAML file")])
    names = information.get("relative_file_paths")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        return Told(information, custom=custom_of(information), flaws=[f"{FILE_NAME}: names no files"])
    mode = str(information.get("compression_mode", "")).lower()
    return Told(information, names, custom_of(information), compressed_messages=mode == "message")


def bag_files(folder: Path) -> tuple[list[Path], list[str]]:
    """The files of a bag in the order of their numbers, and what has the name of one and is none (OSError)."""
    files, flaws = [], []
    with os.scandir(folder) as entries:
        for _, entry in zip(range(MOST_ENTRIES), entries, strict=False):
            if suffix_of(entry.name) in STORAGES:
                kind = _kind_of(entry)
                files += [] if kind else [folder / entry.name]
                flaws += [f"{entry.name}: is {kind}, and only regular files of the folder are read"] if kind else []
    return sorted(files, key=lambda file: (_number(file), file.name)), sorted(flaws)


def suffix_of(name: str) -> str:
    """Ending of a file's name that tells its format; compressed or not."""
    return Path(name.removesuffix(COMPRESSED)).suffix


def chosen_files(folder: Path, names: list[str]) -> tuple[list[Path], list[str]]:
    """The files of a bag of which metadata.yaml tells `names`, and what is wrong with them.

    A name is one of a file in the folder; bags of old releases put the folder's own name before it. When none of the
    named files is there, every file of the folder is the bag's.
    """
    files, flaws = bag_files(folder)
    here = {file.name: file for file in files}
    named = {name: PurePosixPath(name).name for name in dict.fromkeys(names)}
    missing = [name for name, last in named.items() if last not in here and not _is_flawed(last, flaws)]
    flaws += [f"{name}: {FILE_NAME} names this file, and it is not in the folder" for name in missing]
    found = [here[name] for name in dict.fromkeys(named.values()) if name in here]
    if not found:
        return files, flaws
    flaws += [f"{file.name}: {FILE_NAME} does not name this file; it is not read" for file in files
              if file not in found and file.stat().st_size]
    return found, flaws


def opened_part(path: Path, stack: ExitStack) -> Part:
    """A file of a bag, looked through; what is unfolded for that goes with the stack.

    Raises
    ------
    ForeignFileError, DatabaseError
        When it is nothing that can be read.
    OSError
        When the disk fails.
    """
    source = _unfolded(path, stack) if path.name.endswith(COMPRESSED) else path
    return _KINDS[suffix_of(path.name)](source, path.name)


def opened_parts(files: list[Path], stack: ExitStack) -> tuple[list[Part], list[str]]:
    """Those of the files that can be opened, in the order of time, and why the others cannot."""
    parts, flaws = [], []
    for path in files:
        try:
            parts.append(opened_part(path, stack))
        except (ForeignFileError, DatabaseError) as error:
            flaws.append(f"{path.name}: {error}")
        except OSError as error:
            if error.errno in (errno.EMFILE, errno.ENFILE):
                raise
            flaws.append(f"{path.name}: {error.strerror or error}")
    parts.sort(key=lambda part: part.contents.information.first if part.contents.information.messages else 0)
    return parts, flaws


def _kind_of(entry: os.DirEntry) -> str:
    """What an entry is that is no regular file; empty for one."""
    try:
        return kind_of(entry.stat(follow_symlinks=False).st_mode)
    except OSError as error:
        return f"unknown ({error.strerror})"


def _is_flawed(name: str, flaws: list[str]) -> bool:
    return any(flaw.startswith(f"{name}: ") for flaw in flaws)


def _number(file: Path) -> int:
    found = re.search(r"_(\d{1,18})$", Path(file.name.removesuffix(COMPRESSED)).stem)
    return int(found[1]) if found else 0


def _unfolded(path: Path, stack: ExitStack) -> Path:
    """A compressed file, unfolded into a folder that goes with the stack."""
    target = Path(stack.enter_context(tempfile.TemporaryDirectory())) / path.name.removesuffix(COMPRESSED)
    size = 0
    try:
        with open_to_read(path, follow=False) as source, zstd.open(source) as content, target.open("xb") as file:
            while block := content.read(_BLOCK):
                size += len(block)
                if size > LARGEST_UNFOLDED:
                    raise ForeignFileError(f"unfolds to more than {LARGEST_UNFOLDED} bytes; unfold it with `zstd -d`")
                file.write(block)
    except (zstd.ZstdError, EOFError) as error:
        raise ForeignFileError(f"cannot be unfolded: {error}") from error
    return target


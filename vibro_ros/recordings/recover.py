"""The `recover` executable: seals a bag whose recorder was killed, so that other programs can read it, too.

Each file without a footer is replaced by a sealed copy of all its messages. The file itself is kept beside it, unless
the copy has all that was in it. A file with a footer is left as it is, even if it is damaged. metadata.yaml is written
last, whole or not at all. When a step fails (the disk is full), the bag is as it was, and recovery can be repeated. No
link is followed.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    from vibro_ros.process.entry_point import enter

    raise SystemExit(enter("recover"))

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path

from vibro_ros.bag.folders import SUFFIX, locked, writing_processes
from vibro_ros.bag.mcap_file import McapFile
from vibro_ros.bag.metadata import FILE_NAME, as_text, bag_information, write_metadata
from vibro_ros.bag.stream import BagContents, BagError, BagStream, check_is_bag, flaw_lines
from vibro_ros.process.entry_point import BAD_INPUT, Parser, exit_code, say
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.files import is_temporary, one_line, replacement, user_path


class InUseError(BagError):
    """The bag is being recorded, or another process is sealing it."""


@dataclass(frozen=True)
class Recovery:
    """Result of sealing a bag, which has `messages` messages now, the last with the stamp `last` [ns] (0 without any).

    `cut` is the number of torn bytes; the files `kept` are the torn ones as they were. `was_sealed` says that the bag
    was sealed before and nothing was done; `flaws` are sentences on the parts of the bag that cannot be read.
    """

    folder: Path
    messages: int
    cut: int
    last: int
    was_sealed: bool = False
    kept: tuple[Path, ...] = ()
    flaws: tuple[str, ...] = ()


def main(words: Sequence[str]) -> int:
    """Seal each bag; return 0 when all are sealed now, else 2, with a line on stderr for each that cannot be."""
    return exit_code("recover", lambda: _run(words))


def recover(path: str | Path) -> Recovery:
    """Seal the bag in the folder `path`, or the bag of the MCAP file `path`.

    A file of which the sealed copy lacks anything is kept as ``<file>.torn``, ``<file>.torn.2``, …
    BagError when it is no bag, holds nothing that can be read, is being recorded (`InUseError`), or cannot be written.
    """
    path = user_path(path)
    folder = path.absolute().parent if path.suffix == SUFFIX and path.is_file() else path
    try:
        check_is_bag(folder)
        with locked(folder):
            if writers := writing_processes([folder]):
                processes = ", ".join(map(str, writers[folder]))
                raise InUseError(f"{folder}: the bag is in use, process {processes} writes to it; end the recorder")
            return _recovered(folder)
    except BlockingIOError:
        raise InUseError(f"{path}: the bag is in use, its recorder still runs; end the recorder") from None
    except OSError as error:
        raise BagError(f"{path}: cannot be sealed: {error.strerror or error}; nothing readable was lost, make room or "
                       "give write permission and try again") from error
    except MemoryError:
        raise BagError(f"{path}: cannot be sealed: not enough memory; nothing readable was lost") from None


def recovery_lines(recovery: Recovery, stamp: Callable[[int], str]) -> Iterable[str]:
    """Yield lines for people on the result of sealing; `stamp` formats a time [ns]."""
    if recovery.was_sealed:
        yield one_line(f"{recovery.folder}: sealed already, {recovery.messages} messages; nothing to do")
    else:
        lost = f"{recovery.cut} torn bytes cut" if recovery.cut else "no bytes lost"
        kept = f", kept in {', '.join(path.name for path in recovery.kept)}" if recovery.kept else ""
        last = f", the last of {stamp(recovery.last)}" if recovery.messages else ""
        yield one_line(f"{recovery.folder}: sealed, {recovery.messages} messages{last}; {lost}{kept}")
    yield from flaw_lines(recovery.flaws)


def _recovered(folder: Path) -> Recovery:
    bag = BagContents(folder, all_files=True)
    if not bag.files:
        raise BagError(f"{folder / (bag.flaws or ['it holds no .mcap file'])[-1]}; give the folder of a recording")
    files, names = [file.information for file in bag.files], bag.information.get("relative_file_paths")
    damaged = [file.flaws[0] for file in bag.files if file.damaged]
    if damaged and not any(file.messages for file in files):
        raise BagError(f"{folder}: nothing in it can be read: {damaged[0]}")
    if (all(file.sealed for file in bag.files) and isinstance(names, list)
            and sorted(map(str, names)) == sorted(file.name for file in files)):
        return _read_back(folder, was_sealed=True)
    for name in filter(is_temporary, os.listdir(folder)):  # of a recovery that was killed
        (folder / name).unlink()
    cut, kept = 0, []
    for file in bag.files:
        if not file.sealed:
            cut += file.size - file.end
            text = as_text(bag_information([file.information], file.topics, file.custom or bag.custom))
            kept += _seal(file, text)
    written = str(sum(file.messages for file in files))
    custom = {**bag.custom, "written": written, "recovered": "true", "cut_bytes": str(cut)}
    metadata = folder / FILE_NAME
    if os.path.lexists(metadata) and (os.path.islink(metadata) or metadata.is_dir() or metadata.stat().st_size):
        kept.append(metadata.rename(_torn_name(metadata)))
    topics = {topic.name: topic for file in reversed(bag.files) for topic in file.topics}  # the first file wins
    write_metadata(metadata, bag_information(files, [*topics.values()], custom))
    return _read_back(folder, cut, tuple(kept))


def _seal(file: McapFile, metadata: str) -> list[Path]:
    """Replace a file by a sealed copy, with the bag's `metadata` as text (OSError; the file is then as it was).

    The file is kept under another name if the copy lacks any of it; the path is returned.
    """
    kept = [_torn_name(file.path)] if not file.is_whole else []
    with replacement(file.path) as copy:
        file.copy_sealed(copy, metadata)
        copy.flush()  # there is room for it
        for path in kept:
            try:
                path.hardlink_to(file.path)
            except OSError:  # a file system without hard links
                file.path.rename(path)
    return kept


def _torn_name(path: Path) -> Path:
    """Return a free path beside `path` for a file that a copy replaces: ``<file>.torn``, ``<file>.torn.2``, …"""
    names = (path.with_name(f"{path.name}.torn{suffix}") for suffix in chain([""], (f".{i}" for i in count(2))))
    return next(name for name in names if not os.path.lexists(name))


def _read_back(folder: Path, cut: int = 0, kept: tuple[Path, ...] = (), was_sealed: bool = False) -> Recovery:
    """Read the bag again and return the result with what a reader finds now."""
    with BagStream(folder) as stream:
        messages = sum(topic.messages for topic in stream.topics.values())
        return Recovery(folder, messages, cut, stream.end, was_sealed, kept, tuple(stream.flaws))


def _run(words: Sequence[str]) -> int:
    code = 0
    options = _parser().parse_args(words)
    for bag in options.bags:
        try:
            print("\n".join(recovery_lines(recover(bag), _clock)))
        except BagError as error:
            say("recover", str(error))
            code = BAD_INPUT
    return code


def _clock(stamp: int) -> str:
    """Return a time [ns] as text, in UTC."""
    seconds, nanoseconds = divmod(stamp, 10**9)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{nanoseconds // 10**6:03d} UTC"


def _parser() -> Parser:
    parser = Parser(
        prog="recover",
        description=f"{EXECUTABLES['recover'].does} A file without its end is replaced by a sealed copy, and kept "
        "beside it as FILE.torn if the copy lacks anything; metadata.yaml is written, and the bag is read back. A file "
        "that has its end is not touched. What of a bag cannot be read is named.",
        epilog="Exit code 0: every bag is sealed now; 2: one is no bag, is empty, in use, or cannot be written; "
        "129, 130, 143: stopped by SIGHUP, SIGINT, SIGTERM.")
    parser.add_argument("bags", nargs="+", metavar="BAG_FOLDER", help="folder of a recording")
    return parser

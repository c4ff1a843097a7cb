"""Changes of a bag's files by another hand, whatever they hold; each makes a hostile bag of a good one, in place."""

import os
import random
from collections.abc import Callable
from pathlib import Path

Maker = Callable[[Path], None]
"""Changes the bag folder that it is given; `folder.parent / "outside"` has files that nobody may change."""

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{two}: &{two} [{', '.join(['*' + one] * 9)}]\n" for one, two in zip("abcdefg", "bcdefgh", strict=True))
DEEP = "[" * 100_000


def part(folder: Path) -> Path:
    """The bag's (first) file."""
    return sorted(file for file in folder.iterdir() if file.suffix in (".mcap", ".db3"))[0]


def edited(edit: Callable[[bytearray], bytes | bytearray | None]) -> Maker:
    """Change the bytes of the bag's file."""
    def make(folder: Path) -> None:
        data = bytearray(part(folder).read_bytes())
        part(folder).write_bytes(edit(data) or data)
    return make


def flipped(seed: int, name: str = "") -> Maker:
    """Flip one bit somewhere, in the file or in `name`."""
    def make(folder: Path) -> None:
        path = folder / name if name else part(folder)
        data = bytearray(path.read_bytes())
        data[random.Random(seed).randrange(len(data))] ^= 1 << random.Random(seed + 1).randrange(8)
        path.write_bytes(data)
    return make


def noise(seed: int, size: int) -> Maker:
    """Overwrite a stretch with random bytes."""
    def edit(data: bytearray) -> None:
        at = random.Random(seed).randrange(len(data) - size)
        data[at:at + size] = random.Random(seed).randbytes(size)
    return edited(edit)


def cut(seed: int) -> Maker:
    """End the file early."""
    return edited(lambda data: data[:random.Random(seed).randrange(1, len(data))])


def without_metadata(then: Maker) -> Maker:
    """As a killed recorder leaves it, and then something else."""
    def make(folder: Path) -> None:
        (folder / "metadata.yaml").unlink()
        then(folder)
    return make


def torn(then: Maker) -> Maker:
    """The file lacks its last 100 bytes, and then something else."""
    def make(folder: Path) -> None:
        os.truncate(part(folder), part(folder).stat().st_size - 100)
        then(folder)
    return make


def linked(name: str, target: str) -> Maker:
    """A symbolic link in the place of a file, or beside."""
    def make(folder: Path) -> None:
        path = part(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        path.symlink_to(str(folder.parent / "outside" / target) if "/" not in target else target)
    return make

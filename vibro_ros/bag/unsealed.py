"""Bags that killed recorders have left in a folder."""

import os
from pathlib import Path

from vibro_ros.bag.lock import locked, writers
from vibro_ros.bag.metadata import FILE_NAME
from vibro_ros.bag.parts import bag_files


def unsealed_bags(directory: Path, pattern: str = "*") -> list[Path]:
    """Bag folders in `directory` that are not sealed, hold something, and are not being recorded.

    Folders that this user may not look into belong to somebody else, and links lead elsewhere: neither is listed.

    Parameters
    ----------
    directory : Path
        Where recordings go; it may be missing.
    pattern : str
        Of the folders' names.
    """
    try:
        folders = sorted(folder for folder in directory.glob(pattern) if _is_unsealed(folder))
    except OSError:
        return []
    in_use = writers(folders) if folders else {}
    return [folder for folder in folders if folder not in in_use and not _is_locked(folder)]


def _is_unsealed(folder: Path) -> bool:
    try:
        if folder.is_symlink() or not folder.is_dir() or os.path.lexists(folder / FILE_NAME):
            return False
        files, _ = bag_files(folder)
        return any(file.stat().st_size for file in files)
    except OSError:
        return False


def _is_locked(folder: Path) -> bool:
    try:
        with locked(folder):
            return False
    except OSError:
        return True

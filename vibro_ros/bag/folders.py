"""Names of the folders that bags are written to."""

from collections.abc import Iterator
from datetime import datetime
from itertools import count
from pathlib import Path

BAG_PATTERN = "vibro_robot_*"
"""Of the names that `bag_folders` gives."""

LONGEST_NAMESPACE = 150
"""Characters of a namespace in a folder's name; file systems allow 255 for the whole."""


def bag_folders(directory: Path, now: datetime, namespace: str = "/") -> Iterator[Path]:
    """Names of bag folders, as rosbag2 names them, each to be tried when the one before exists.

    Parameters
    ----------
    directory : Path
        Where recordings go; ``~`` is the home folder.
    now : datetime
        Start of the recording, local time.
    namespace : str
        The robot's, of which the name has at most the first `LONGEST_NAMESPACE` characters.

    Returns
    -------
    Iterator of Path
        ``vibro_robot_YYYY_MM_DD-HH_MM_SS`` in `directory`, in the namespace ``/r1`` ``vibro_robot_r1_YYYY…``, then with
        ``_2``, ``_3``, … Whether a name is free, only the attempt to make the folder tells: another robot may make it
        at the same instant. `Recorder` makes it, and raises FileExistsError.
    """
    own = namespace.rstrip("/").replace("/", "_")[:LONGEST_NAMESPACE]
    folder = Path(directory).expanduser() / now.strftime(f"vibro_robot{own}_%Y_%m_%d-%H_%M_%S")
    yield folder
    yield from (folder.with_name(f"{folder.name}_{number}") for number in count(2))

"""The `view` executable: writes a recording as one HTML file, or shows a live robot in the browser."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("view"))

import argparse
import webbrowser
from collections.abc import Sequence
from importlib import import_module, metadata
from pathlib import Path

from tqdm import tqdm

from vibro_ros.bag.stream import BagError, bag_errors
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import Parser, exit_code, say
from vibro_ros.process.executables import EXECUTABLES, shows_live_robot
from vibro_ros.process.files import one_line, open_to_read, replace_file, user_path
from vibro_ros.view.bag_motion import bag_motion
from vibro_ros.view.page import MARK, page_text

_HEAD = 4096  # bytes at the beginning of a file in which a page has its mark


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("view", lambda: _live(words) if shows_live_robot(words) else _run(words))


def _live(words: Sequence[str]) -> int:
    try:
        live = import_module("vibro_ros.ros.live.view")  # nothing else here needs ROS
    except ModuleNotFoundError as error:
        raise RuntimeError(f"{(error.name or str(error)).partition('.')[0]}: no such Python module here; a live robot "
                           "needs ROS 2 Jazzy: source an installation, or use the environment that `make setup` makes"
                           ) from None
    return live.main(words)


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    with bag_errors(options.bag):
        path = write_page(options.bag, options.output, load_scene(options.scene) if options.scene else None)
        print(one_line(path))
    if options.open and not webbrowser.open(path.resolve().as_uri()):
        say("view", "no browser could be opened; open the file above")
    return 0


def write_page(bag_folder: Path, output: Path | None = None, scene: Scene | None = None) -> Path:
    """Write the page of a recording: one file that needs no network and no other file.

    `scene` is the robot's scene, for a recording that does not state it. Returns the page's path, by default ``<bag
    folder>_view.html`` beside the recording; nothing is ever written into the recording. BagError when the recording
    cannot be read, or states its scene although `scene` is given, or when `output` lies inside it, cannot be written,
    or is a file that `view` has not written; OSError when an existing `output` cannot be read.
    """
    folder = user_path(bag_folder).resolve()
    path = user_path(output).absolute() if output else folder.with_name(f"{folder.name}_view.html")
    if path.resolve().is_relative_to(folder):
        raise BagError(f"{path}: lies inside the recording, which is never written to; give another --output")
    if path.exists() or path.is_symlink():
        with open_to_read(path) as file:
            if MARK.encode() not in file.read(_HEAD):
                raise BagError(f"{path}: is there, and no page that `view` wrote; give another --output")
    with tqdm(total=1.0, desc="view", delay=1.0, disable=None, leave=False,
              bar_format="{desc}: {percentage:3.0f} %|{bar}| {elapsed}") as bar:
        parts, header, payload = bag_motion(folder, lambda share: bar.update(max(0.0, share - bar.n)), scene)
    text = page_text({**parts, "mode": "bag", "version": metadata.version("vibro_ros")}, (header, payload))
    try:
        replace_file(path, text.encode())
    except OSError as error:
        raise BagError(f"{path}: cannot write: {error.strerror or error}; give a writable --output") from None
    return path


def _parser() -> Parser:
    parser = Parser(
        prog="view", formatter_class=argparse.RawDescriptionHelpFormatter, description=EXECUTABLES["view"].does,
        usage="view BAG_FOLDER [--output FILE] [--scene NAME] [--open]\n"
        "       view [--robot NODE] [--address ADDRESS] [--port PORT] [--open] "
        "[--ros-args ...]",
        epilog="The first form writes a recording as one HTML file, which can be mailed and needs no network: the\n"
        "robot drawn to scale, charts, and slow motion from impact to impact, exact between the samples.\n\n"
        "The second form serves a page of a live robot, and prints its address: the same, with knobs and buttons.\n"
        "--robot names the robot's node (vibro_robot), --address and --port say where the page is served\n"
        "(127.0.0.1 and 8742; port 0: any that is free), --open opens the browser, in either form.\n\n"
        "Exit code 0: written, or, of a live view, ended by SIGINT, SIGTERM or SIGHUP; 1: the server failed; 2: no\n"
        "readable recording, nowhere to write, a bad argument, or the port is taken; 129, 130, 143: stopped by\n"
        "SIGHUP, SIGINT, SIGTERM while it read a recording.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of the recording")
    parser.add_argument("--output", type=Path, metavar="FILE",
                        help="where to write the recording's page (default: BAG_FOLDER_view.html)")
    parser.add_argument("--scene", metavar="NAME", help="scene that the robot simulated, by name or file, of a "
                        "recording that does not say it: another recorder's")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    return parser

"""The `recover` executable: seals bags whose recorder was killed."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("recover"))

from collections.abc import Sequence
from datetime import UTC, datetime

from vibro_ros.bag.recovery import RecoveryError, described, recover
from vibro_ros.process.entry_point import BAD_INPUT, Parser, exit_code, say
from vibro_ros.process.executables import EXECUTABLES


def main(words: Sequence[str]) -> int:
    """Seal each bag; 0 when all are sealed now, 2 with a line on stderr for each that cannot be."""
    return exit_code("recover", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    code = 0
    options = _parser().parse_args(words)
    for bag in options.bags:
        try:
            print("\n".join(described(recover(bag, keep_torn=not options.discard_torn), _clock)))
        except RecoveryError as error:
            say("recover", str(error))
            code = BAD_INPUT
    return code


def _clock(stamp: int) -> str:
    """A time [ns] for people, UTC."""
    seconds, nanoseconds = divmod(stamp, 10**9)
    try:
        return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{nanoseconds // 10**6:03d} UTC"
    except (ValueError, OverflowError):
        return f"{stamp} ns"


def _parser() -> Parser:
    parser = Parser(
        prog="recover",
        description=f"{EXECUTABLES['recover'].does} The torn end is cut and kept beside as FILE.torn; index and "
        "metadata.yaml are written in place, and the bag is read back. A sealed bag is not touched. What of a bag "
        "cannot be read is named.",
        epilog="Exit code 0: every bag is sealed now; 2: one is no bag, is empty, in use, or cannot be written; "
        "129, 130, 143: stopped by SIGHUP, SIGINT, SIGTERM.")
    parser.add_argument("bags", nargs="+", metavar="BAG_FOLDER", help="folder of a recording")
    parser.add_argument("--discard-torn", action="store_true", help="do not keep what is cut, where there is no room")
    return parser

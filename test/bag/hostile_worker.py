"""Reads the bag folders named on stdin by every reader, within limits, and prints the result of each as a line of JSON.
"""

import contextlib
import io
import json
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from pathlib import Path

from matplotlib.figure import Figure

from vibro_ros.bag.reader import BagError, load_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings import recover, replay, report

MEMORY = 6 * 2**30  # bytes of address space; libraries take 3 of them
DEADLINE = 120  # s, for one reader of one bag on a busy machine


def run_main(main, *arguments: str) -> dict:
    """Run an executable's `main`, and return its exit code, its lines and its processor time [s]."""
    out, err = io.StringIO(), io.StringIO()
    began = time.process_time()
    signal.alarm(DEADLINE)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            code = main(arguments)
    except BaseException:
        code = traceback.format_exc()
    finally:
        signal.alarm(0)
    return {"code": code, "out": out.getvalue(), "err": err.getvalue(), "time": time.process_time() - began}


def read_folder(arguments) -> int:
    """Run `read_bag` as if it were an executable; its line has the number of messages and of flaws."""
    try:
        bag = load_bag(arguments[0])
    except BagError as error:
        print(error, file=sys.stderr)
        return 2
    with BagStream(arguments[0]) as stream:
        print(json.dumps([sum(1 for _ in stream.messages()), list(bag.flaws)]))
    return 0


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(TimeoutError("too long")))
    report.plot_run = lambda *_: Figure()  # pictures take longer than all the rest
    for line in sys.stdin:
        folder = Path(line.rstrip("\n"))
        output = folder.parent / "report"
        found = {"replay": run_main(replay.main, str(folder)), "read": run_main(read_folder, str(folder)),
                 "report": run_main(report.main, str(folder), "--output", str(output))}
        shutil.rmtree(output, ignore_errors=True)
        print(json.dumps(found), flush=True)
        sys.stdin.readline()  # the bag is looked at meanwhile
        found = {"recover": run_main(recover.main, str(folder)), "again": run_main(recover.main, str(folder)),
                 "read": run_main(read_folder, str(folder)), "replay": run_main(replay.main, str(folder))}
        print(json.dumps(found), flush=True)


main()

"""Energy accounts of a recorded run, from simulating it again with its commands."""

from typing import Any

import numpy as np
from tqdm import tqdm

from vibro_ros.bag.reader import Arrays, Bag
from vibro_ros.bag.stream import BagError, BagStream
from vibro_ros.messages.topics import CHECKPOINT, INPUTS, OPERATIONS
from vibro_ros.recordings.rerun import RecordedRun, Rerun, most_ticks, recorded_run
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.samples import resets

#: Accounts of received energy, with their signs, and of lost energy. With a dc motor the supply counts in place of what
#: the motor delivered, because all of that comes from the supply.
RECEIVED = {"motor_delivered": 1.0, "motor_taken_back": -1.0, "plates": 1.0, "unpaid": 1.0}
RECEIVED_BY_DC = {"supply": 1.0, "plates": 1.0, "unpaid": 1.0}
LOST = ("drive_dampers", "plate_dampers", "friction", "blows", "landings", "copper", "bearing")

_BAR_DELAY = 2.0  # s, until the progress bar is shown


def energy_of(bag: Bag) -> dict[str, Any]:
    """Return the energy accounts of a recorded run, from its first odometry to its last, ready for JSON.

    The run must have the method exact, and the run simulated again must end at the same position to the last bit; else
    the accounts are unknown.

    Returns
    -------
    dict
        ``duration`` [s]; ``accounts``, the changes of `Simulator.statistics`'s ``energy_accounts`` [J];
        ``mean_power`` [W], the motor's net work (of a dc motor, that of its supply) over the duration;
        ``cost_of_transport``, this work over weight times displacement, None if that is 0. Or only ``unknown``, a
        sentence that says why there are no accounts.
    """
    try:
        with BagStream(bag.path) as stream:
            return _energy(bag, stream, recorded_run(stream))
    except (BagError, SimulationError) as reason:
        return {"unknown": str(reason)}


def _energy(bag: Bag, stream: BagStream, run: RecordedRun) -> dict[str, Any]:
    if (method := run.scene["solver.method"]) != "exact":
        raise BagError(f"the accounts need solver.method exact; the run was recorded with {method}")
    body = bag["odom"]
    times, x = body["time"], body["position"][:, 0]
    if not len(times):
        raise BagError("no odometry is recorded")
    first, last = (run.tick(bag.start_ns + round(float(time) * 1e9)) for time in times[[0, -1]])
    if first is None or last is None:
        raise BagError("the stamps of its odometry are not those of the robot's samples")
    if run.lacks_beginning:
        raise BagError("the recording begins after the robot's start, without a checkpoint")
    rerun = Rerun(run, run.scene.with_parameters({"solver.accounts": True}))
    first, accounts = _accounts(rerun, stream, run, first, last, len(times))
    if rerun.device.state.body_position != x[-1]:
        raise BagError("simulated again, the run is not the recorded one; `replay` tells where they part")
    displacement = float(differences_between_resets(times, x, reset_times(bag["joint_states"])).sum())
    duration = run.time(last - first)
    work = accounts.get("supply", accounts["motor_delivered"] - accounts["motor_taken_back"])
    transport = run.scene.total_mass * run.scene["gravity"] * abs(displacement)  # weight times displacement [J]
    return {"duration": duration, "accounts": accounts, "mean_power": work / duration if duration else None,
            "cost_of_transport": work / transport if transport else None}


def _accounts(rerun: Rerun, stream: BagStream, run: RecordedRun, first: int, last: int,
              recorded: int) -> tuple[int, dict[str, float]]:
    """Simulate the run to the sample `last`; return the sample from which its accounts count, and their changes [J].

    The accounts count from the sample `first`, or from a later one at which the bag has its first checkpoint.
    `recorded` is the number of messages of odometry.
    """
    if not run.begins_late:
        _check_span(stream, run, last - rerun.tick, recorded)
    accounts: dict[str, float] = {}  # since the robot's start, summed over resets
    at_first, of_earlier_runs, resets = accounts, accounts, 0
    samples = rerun.through(stream, (*INPUTS, CHECKPOINT), until=last)
    for tick, messages in tqdm(samples, total=last, desc="energy", unit=" samples", delay=_BAR_DELAY):
        if rerun.tick < 0:  # before the bag's first checkpoint
            continue
        if tick is None:
            first = max(first, rerun.tick)
            _check_span(stream, run, last - rerun.tick, recorded)
        if rerun.resets > resets:
            of_earlier_runs, resets = accounts, rerun.resets
        if rerun.tick in (first, last) or any(name == OPERATIONS for name, _ in messages):
            of_this_run = rerun.device.statistics["energy_accounts"]
            accounts = {name: amount + of_earlier_runs.get(name, 0.0) for name, amount in of_this_run.items()}
        if rerun.tick == first:
            at_first = accounts
        if rerun.tick == last:
            return first, {name: amount - at_first[name] for name, amount in accounts.items()}
    raise BagError("no odometry follows its first checkpoint")


def _check_span(stream: BagStream, run: RecordedRun, samples: int, recorded: int) -> None:
    """Raise a BagError if the bag has far fewer messages than `samples`; `recorded` counts those of odometry."""
    if samples > most_ticks(stream, run):
        raise BagError(f"only {recorded} of {samples} samples of odometry are recorded")


def reset_times(joints: Arrays) -> np.ndarray:
    """Return the times [s] of the first samples after resets to the start, shape (n,)."""
    return joints["time"][1:][resets(joints["time"], joints["crank.position"], joints["crank.velocity"])]


def differences_between_resets(time: np.ndarray, values: np.ndarray, resets: np.ndarray) -> np.ndarray:
    """Return the differences of neighbouring `values`, shape (n - 1,); 0 across each of the `resets` (times [s])."""
    steps = np.diff(values)
    after = np.searchsorted(time, resets)
    steps[after[(after > 0) & (after < len(time))] - 1] = 0.0
    return steps

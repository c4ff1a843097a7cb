"""Checkpoints: the numbers from which a motion goes on, bit for bit, and which numbers no device can have.

A checkpoint is the time [s], the parameters that may change while the device runs, in the order of `SCENE_PARAMETERS`,
and the arrays of `parts_of`, one after the other. It may come from a forged bag. All numbers must be finite. All
indices must be within their tables, or a kernel would read foreign memory. The numbers of a segment and of the crank's
clock must be within the limits of a device. Whether the numbers are consistent with each other is not checked.
"""

import numpy as np

from vibro_ros.model.parameters import BY_NAME, LIVE
from vibro_ros.simulation.motion import Motion
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import lasting
from vibro_ros.solver.system import NOTHING

_LARGEST = 1e15  # largest number in a device's state, in SI units and counts
_LARGEST_LOCAL_TIME = 1.0 + 1e-9  # in a segment, with rounding
_IMPOSSIBLE = ("the checkpoint is of no state that this device can be in; give one that a device of the same scene and "
               "version has made")


def parts_of(motion: Motion) -> list[np.ndarray]:
    """Return the arrays, to be read or overwritten, that the future depends on besides time, scene and commands.

    The table of the disturbances, which decides the length of the others, is the first.
    """
    return [motion.disturbances.table, motion.point, *lasting(motion.state), *motion.stepper.memory]


def checkpoint_of(motion: Motion) -> np.ndarray:
    """Return the checkpoint of a motion, shape (n,)."""
    return np.concatenate([[motion.time], [motion.scene[name] for name in LIVE],
                           *(part.ravel() for part in parts_of(motion))])


def restore(motion: Motion, checkpoint: np.ndarray) -> None:
    """Go on from a checkpoint (ValueError for one that is not of this device; nothing is changed then)."""
    previous = checkpoint_of(motion)
    try:
        _overwrite(motion, checkpoint)
        if not _is_possible(motion):
            raise ValueError(_IMPOSSIBLE)
    except ValueError:
        _overwrite(motion, previous)
        raise
    motion.events.drop_untaken()


def _overwrite(motion: Motion, checkpoint: np.ndarray) -> None:
    """Overwrite time, live parameters and parts of a motion; which may leave it in an impossible state."""
    table, end = motion.disturbances.table, 1 + len(LIVE)
    if np.ndim(checkpoint) == 1 and len(checkpoint) >= end + table.size:
        live = dict(zip(LIVE, np.asarray(checkpoint[1:end], float).tolist(), strict=True))
        scene = motion.scene
        if any(scene[name] != value for name, value in live.items()):
            try:
                scene = scene.with_parameters(live)
            except ValueError as error:
                raise ValueError(f"{_IMPOSSIBLE} ({error})") from None
        motion.time = float(checkpoint[0])
        table[...] = checkpoint[end:end + table.size].reshape(table.shape)
        motion.compile_overwritten(scene)
    parts = parts_of(motion)
    size = end + sum(part.size for part in parts)
    if np.shape(checkpoint) != (size,):
        raise ValueError(f"the checkpoint has shape {np.shape(checkpoint)}, this device's have ({size},); give one "
                         "of the same scene and version")
    for part in parts:
        with np.errstate(invalid="ignore"):  # a number that is no integer becomes one that `_is_possible` refuses
            part[...] = checkpoint[end:end + part.size].reshape(part.shape)
        end += part.size
    motion.go_on_from_overwritten(restored=True)


def _is_possible(motion: Motion) -> bool:
    """Return whether a device can go on from the overwritten parts of a motion."""
    system, scene, state = motion.model.system, motion.scene, motion.state
    now = state.now[0]
    segment, drive, automaton = now["segment"], now["drive"], now["automaton"]
    indices = ((automaton["mode"], 0, len(motion.model.modes)),
               (automaton["guard"], NOTHING, system.guards.row.shape[1]),
               (drive["cell"], 0, len(system.signals.reach)))
    if not (all(low <= index < high for index, low, high in indices) and drive["direction"] in (-1, 1)
            and motion.has_own_filters()):
        return False
    fastest, width = BY_NAME["motor.max_speed"].maximum, float(np.diff(system.signals.start)[drive["cell"]])
    spans = [(segment["half"], 0.0, LONGEST_SEGMENT), (abs(segment["residue"]), 0.0, LONGEST_SEGMENT),
             (motion.time - segment["start"], -2.0 * LONGEST_SEGMENT, 2.0 * LONGEST_SEGMENT),
             *((segment[name], -_LARGEST_LOCAL_TIME, _LARGEST_LOCAL_TIME) for name in ("mode_start", "next_event")),
             (drive["offset"], 0.0, width * _LARGEST_LOCAL_TIME), (drive["speed"], 0.0, fastest)]
    numbers = np.concatenate([np.ravel(part) for part in parts_of(motion)])
    infinite = np.count_nonzero(~(np.abs(numbers) <= _LARGEST))
    return (all(low <= number <= high for number, low, high in spans)
            and motion.disturbances.are_possible(scene, motion.model.forms, motion.time)
            and infinite == (segment["cell_left"] > _LARGEST))  # infinite if the crank stands, or nearly so

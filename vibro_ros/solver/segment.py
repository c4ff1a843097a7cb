"""Segments: the part of time that one polynomial a channel describes, and the clock that the segments move.

A segment is a whole cell of the signals where the flow's series reaches so far and the speed hardly changes, so that
the series of the cell serve again; the flow then starts on the way. Elsewhere the segment starts with the flow and ends
with the cell, with a ramp, or where a series no longer reaches rounding.
"""

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.drive import enter_next_cell, measure_cell, resolved_time, time_to_advance
from vibro_ros.solver.system import CELL_RATE

#: A segment without a fast motion, a signal or a ramp to end it ends after this time [s].
LONGEST_SEGMENT = 1.0


@kernel
def local_time(state, time):
    """Local time of the instant `time` [s]: -1 at the segment's start, 1 at its end."""
    segment = state.now[0].segment
    return ((time - segment.start) - segment.residue) / segment.half - 1.0


@kernel
def instant(state, x):
    """Instant [s] of the local time `x`."""
    segment = state.now[0].segment
    return segment.start + (segment.residue + segment.half * (x + 1.0))


@kernel
def local_to_piece(segment, x):
    """Local time of the present piece, -1 at its start and 1 at its end, at the local time `x` of the segment."""
    return (x - segment.piece_middle) / segment.piece_half


@kernel
def set_piece(segment, start, end):
    """Let the present piece lie between these local times of the segment."""
    segment.piece_middle, segment.piece_half, segment.piece_end = 0.5 * (start + end), 0.5 * (end - start), end


@kernel
def advance_clock(state, elapsed):
    """Move the segment's start by `elapsed` [s] and store what rounding takes from the sum."""
    segment = state.now[0].segment
    increment = elapsed + segment.residue
    total = segment.start + increment
    segment.residue = increment - (total - segment.start)
    segment.start = total


@kernel
def _cell_times(drive, width):
    """Duration [s] of the whole cell, of the `width` [rad], and the time [s] from its start to the segment's start; a
    duration of 0 if no segment may be the cell."""
    if drive.time_left > 0.0:
        return drive.cell_time, drive.since
    if drive.speed <= 0.0:
        return 0.0, 0.0
    return width / drive.speed, drive.offset / drive.speed


@kernel
def _spans_cell(system, state, duration, since, longest):
    """Whether a segment may be the whole cell: if the flow's series reaches so far, and nothing changes on the way."""
    if duration > min(LONGEST_SEGMENT, CELL_RATE * system.longest_segment[state.now[0].automaton.mode], longest):
        return False
    left, drive = duration - since, state.now[0].drive
    if duration == 0.0 or 0.0 < drive.time_left <= left:
        return False
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0 and state.ramp[k].time_left <= left:
            return False
    return True


@kernel
def _return_to_cell(state, back):
    """Move the segment's start back by `back` [s] to the start of the cell, and the mode's start to where it was."""
    segment, drive = state.now[0].segment, state.now[0].drive
    now, residue = segment.start, segment.residue
    drive.offset = 0.0
    if drive.time_left > 0.0:
        drive.since, drive.speed = 0.0, drive.cell_speed
        drive.time_left += back
    advance_clock(state, -back)
    segment.mode_start = ((now - segment.start) + (residue - segment.residue)) / segment.half - 1.0
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            state.ramp[k].value -= state.ramp[k].rate * back
            state.ramp[k].time_left += back


@kernel
def part_of_cell(system, state, longest):
    """Duration [s], at most `longest`, of a segment that is not a whole cell, as far as the forcing goes."""
    segment, drive = state.now[0].segment, state.now[0].drive
    duration = min(LONGEST_SEGMENT, segment.cell_left, longest, resolved_time(drive, system.signals.reach[drive.cell]))
    if drive.time_left > 0.0:
        duration = min(duration, drive.time_left)
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            duration = min(duration, state.ramp[k].time_left)
    return duration


@kernel
def _width(system, drive):
    """Width [rad] of the present cell."""
    return system.signals.start[drive.cell + 1] - system.signals.start[drive.cell]


@kernel
def _is_cell_over(drive, width):
    """Whether the segment starts where the cell, of the `width` [rad], ends."""
    return drive.offset >= width or (drive.time_left > 0.0 and 0.0 < drive.cell_time <= drive.since)


@kernel
def choose_segment(system, state, longest):
    """Set the segment's extent, at most `longest` [s], and the local time at which flow and mode start."""
    segment, drive = state.now[0].segment, state.now[0].drive
    width = _width(system, drive)
    if _is_cell_over(drive, width):
        enter_next_cell(system, drive)
        width = _width(system, drive)
    if drive.offset == 0.0 and drive.time_left > 0.0:
        measure_cell(drive, width)
    segment.mode_start = -1.0
    duration, since = _cell_times(drive, width)
    if _spans_cell(system, state, duration, since, longest):
        segment.cell_left = duration
        segment.half = 0.5 * duration
        if drive.offset > 0.0:
            _return_to_cell(state, since)
        segment.slot = drive.cell
    else:
        if drive.time_left > 0.0 and duration > 0.0:
            segment.cell_left = duration - since
        else:
            segment.cell_left = time_to_advance(drive, width - drive.offset)
        duration = part_of_cell(system, state, min(longest, system.longest_segment[state.now[0].automaton.mode]))
        segment.slot = len(system.signals.start) - 1
    segment.flow_start = segment.mode_start
    segment.half = 0.5 * duration

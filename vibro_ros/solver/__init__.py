"""Event-driven integration of piecewise linear systems; knows nothing of robots.

Tables (`system.System`), a state (`state.State`) and instants come in; channels, modes and events at these instants go
out. Read `system` first, then `event_loop`. Five spans of time are nested:

- *turn*: one period of the signals' phase;
- *cell*: a part of a turn over which one polynomial of the phase describes each signal (`system.SignalTable`);
- *segment*: a part of a cell, or all of it, over which one polynomial of time describes each channel
  (`segment.choose_segment`);
- *flow*: the motion of the dynamic coordinates by one set of equations; it starts with a segment, and ends with a jump
  or a change of these equations, which ends the segment (`flow.solve_dynamic`);
- *mode*: one state of each effect; it decides the equations of all coordinates and the guards. A mode that changes only
  the equations of driven coordinates starts while the flow goes on (`event_loop.advance`).

One impact passes three modules: `guards.find_next_event` finds the root of the guard, `event_loop.advance` passes it,
and `events.transition` chooses the next mode and the jump to it, which `events.record_mode_change` records.
"""

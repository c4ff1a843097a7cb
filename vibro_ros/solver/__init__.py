"""Event-driven integration of piecewise linear systems; knows nothing of robots.

Five times are nested:

- *turn*: one period of the signals' phase;
- *cell*: a part of a turn over which one polynomial of the phase describes each signal (`system.SignalTable`);
- *segment*: a part of a cell, or all of it, over which one polynomial of time describes each channel
  (`segment.choose_segment`);
- *flow*: the motion of the dynamic coordinates by one set of equations; it starts with a segment, and ends with a jump
  or a change of these equations, which ends the segment (`flow.solve_dynamic`);
- *mode*: one state of all contacts and of friction; it names the equations of all coordinates and the guards. A mode
  that changes the equations of driven coordinates alone starts while the flow goes on (`event_loop.advance`).

One impact, in three chapters: `guards.find_next_event` finds the root of the guard, `event_loop.advance` passes it, and
`events.transition` decides what follows while `events.record_mode_change` records it.
"""

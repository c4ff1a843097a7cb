"""What accuracy costs: every program on one problem, its error against a reference, its cost against one unit.

A problem comes in (a scene within a horizon, or one of the benchmark with stored values), and rows go out: a setting of
a program, its errors, its cost. Read in this order:

- `programs`: what a program is, what it answers, and the device's own methods;
- `harness`: `Problem`, the one error, the one cost, `Row`, and `rows(problem, program)`;
- `scene_rows`: how long chaos lets trajectories of a scene be compared, what checks the reference, mean speeds;
- `report` and `chart`: rows in words, tables and a diagram;
- `accuracy`: the executable. `benchmark/` at the repository's root runs the same harness with more programs.
"""

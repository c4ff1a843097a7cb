"""Work-precision comparison: errors of simulation programs against a reference, and their cost per simulated second.

A problem comes in (a scene up to a horizon, or a benchmark problem with stored values). Rows go out, each with a
setting of a program, its errors and its cost. Read in this order:

- `programs`: the interface of a program, its answers, and the device's own methods;
- `harness`: `Problem`, the error, the cost, `Row`, and `rows(problem, program)`;
- `scene_rows`: the horizon to which chaos allows a comparison, the check of the reference, and mean speeds;
- `report`: words and diagrams from rows;
- `accuracy`: the executable. `lab/benchmark/` runs the same harness with more programs.
"""

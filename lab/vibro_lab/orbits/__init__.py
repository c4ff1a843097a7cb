"""Long-term motions of a scene: attractors, periodic orbits, their stability, their branches, and chaos.

A `Scene` whose crank turns comes in; orbits, branches, attractors and exponents go out. Nothing is printed or written.

1. `turn_map` computes the state one turn of the crank later (a Poincare map). Read it first.
2. `starts` draws random starts, `recurrence` finds the motion that a start settles to, and `attractors` groups the
   starts by motion, with shares.
3. `orbit` solves for a periodic motion by Newton's method, with its Floquet multipliers and their error.
4. `passage` lists the events of a turn in their order; the map is smooth as long as this order does not change.
5. `family` has the equations of an orbit over a parameter, and `continuation` the steps along a branch and its special
   points.
6. `branch` assembles whole branches, from the first orbit to the last.
7. `chaos` computes Lyapunov exponents.
"""

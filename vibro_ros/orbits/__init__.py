"""Motions as the turn map has them: which a scene has, how stable they are, where they begin and end.

A `Scene` whose crank turns comes in; orbits, branches, attractors and exponents go out. Nothing is printed or written.

1. `turn_map` gives the state one turn later, cut where nothing touches. Read it first.
2. `recurrence` tells what a start settles to, `starts` draws starts, and `attractors` groups them, with shares.
3. `orbit` closes a periodic motion by Newton's method, with its multipliers and their error.
4. `passage` is the order of a turn's events: the map is smooth as long as it stays.
5. `family` has the equations of an orbit over one or two parameters, `continuation` the steps along a branch and its
   special points, and `bifurcation` what folds, doublings and grazings over two parameters need more.
6. `branch` has whole branches, over one parameter or two, from the begin to the end.
7. `chaos` measures Lyapunov exponents and has the 0-1 test.
"""

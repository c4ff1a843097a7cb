"""The physics of the vibro-impact robot, as tables for the solver.

Parameters come in, a `tables.Model` goes out: the solver's `System`, and what reads its channels. Begin with `scene`: a
`Scene` is one choice of every parameter of `parameters`, checked by `parameter_checks`. `tables.compile_scene` makes
the model: `forms` writes forces and distances as linear forms of the channels, `slider` the sliders over a turn of the
crank, and `contact`, `ground`, `motor` and `shock` the states, guards and jumps of each effect. `modes` combines the
states to modes, each with its equations; the head of `modes` lists what a new effect takes. `energy` has the accounts,
`description` says in words what is simulated, and `faults` what may fail.
"""

from vibro_ros.model.scene import Scene


def describe(scene: Scene) -> str:
    """Return the states, equations, guards and events that are really simulated, as text.

    Examples
    --------
    >>> print(vibro_ros.load_scene("paper").describe())
    scene paper
    <BLANKLINE>
    states
      u, u'    position [m] and speed [m/s] of the upper mass on its guide
    ...
    """
    from vibro_ros.model import description  # needs numba, half of the time in which a controller starts

    return description.describe(scene)


Scene.describe = describe

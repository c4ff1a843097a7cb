"""The physics of the vibro-impact robot, as tables for the solver.

Parameters come in, a `tables.Model` goes out: the solver's `System`, and the forms of the outputs. Read `scene` first:
a `Scene` is a value for every parameter of `parameters`, checked by `parameter_checks`. `tables.compile_scene` makes
the model: `forms` writes forces and distances as linear forms of the channels, `slider` the sliders over a turn of the
crank, and `contact`, `ground`, `motor` and `shock` the states, guards and jumps of each effect. `modes` combines the
states to modes, each with its equations; its docstring lists the files that a new effect changes. `energy` defines the
energy accounts, `description` writes the simulated equations as text, and `faults` lists the disturbances.
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
    from vibro_ros.model import description  # imports kernels, which a controller does not need

    return description.describe(scene)


Scene.describe = describe

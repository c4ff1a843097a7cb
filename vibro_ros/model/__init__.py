"""The physics of the vibro-impact robot: parameters, slider, contacts, friction, modes and guards."""

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

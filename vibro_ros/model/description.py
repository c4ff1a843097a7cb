"""A scene in words: what the compiled tables really simulate."""


def describe(scene) -> str:
    """States, equations, guards and modes of a scene as compiled."""
    return ""

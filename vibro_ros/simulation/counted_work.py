"""What a run costs in counted work: its steps, segments and events by fixed weights.

A clock gives another answer in every process; the counts of a run are the same in each, so that whatever is decided by
them is, too. The weights are those of one machine, and only their ratios matter;
docs/solver.md tells how they are measured, and how far counted work is from measured time.
"""

from collections.abc import Mapping

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene

#: Weight of a step of fixed length, by scheme [µs a channel of the scene].
STEP_WEIGHTS: Mapping[str, float] = {"rk4": 0.024, "semi_implicit_euler": 0.009, "moreau": 0.019}
#: Weights of the method exact: of a segment and of an event; and of a segment besides, if its energy is balanced, if a
#: friction that decays is followed, or if the motor's speed is on a ramp or lags [µs a channel].
EXACT_WEIGHTS: Mapping[str, float] = {"segment": 0.075, "event": 0.05, "audited": 0.04, "decaying": 0.02,
                                      "ramping": 0.08, "lagging": 0.04}


def counts_of_exact(scene: Scene, segments: int, events: int, speeding: bool) -> dict[str, float]:
    """What `EXACT_WEIGHTS` weigh in a run of `scene` by the method exact; `speeding` if its motor's speed changes."""
    channels = compile_scene(scene).forms.channels
    size, motor = channels.count, scene["effects.motor"] if speeding else "ideal"
    return {"segment": size * segments, "event": size * events,
            "audited": size * segments * scene["solver.audit"], "decaying": size * segments * channels.decays,
            "ramping": size * segments * (motor == "ramp"), "lagging": size * segments * (motor == "lag")}


def counted_work(scene: Scene, steps: int, events: int = 0, speeding: bool = False) -> float:
    """Counted work [s] of a run of `scene` by its own `solver.method`.

    Parameters
    ----------
    scene : Scene
        What was run.
    steps, events : int
        The run's `statistics["steps"]` and, of `exact`, its number of events.
    speeding : bool
        Whether the motor's speed changed during the run.
    """
    if scene["solver.method"] == "exact":
        counts = counts_of_exact(scene, steps, events, speeding)
        return 1e-6 * sum(EXACT_WEIGHTS[name] * count for name, count in counts.items())
    return 1e-6 * STEP_WEIGHTS[scene["solver.method"]] * compile_scene(scene).forms.channels.count * steps

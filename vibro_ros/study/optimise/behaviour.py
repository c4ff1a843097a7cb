"""How an optimum moves, and where its energy goes: what a designer asks of numbers that look too good."""

from collections.abc import Mapping
from dataclasses import dataclass

from vibro_ros.model.scene import Scene
from vibro_ros.study.measures import measure
from vibro_ros.study.observation import device_at_start
from vibro_ros.study.optimise.evaluation import VERIFYING, Trials

_MEASURES = ("upper_impacts", "inclined_impacts", "upper_peak_force", "inclined_peak_force", "stick_share", "air_share")
#: The accounts of energy that are told, in the words of the tables.
ACCOUNTS = {"motor_delivered": "motor delivers", "motor_taken_back": "springs return to the motor",
            "unpaid": "unpaid (artefact without reaction)", "drive_dampers": "lost in drive dampers",
            "plate_dampers": "lost in plate dampers", "friction": "lost by ground friction", "blows": "lost in blows",
            "landings": "lost in landings", "stored": "stored"}


@dataclass(frozen=True)
class Behaviour:
    """A robot from one start.

    Attributes
    ----------
    measures : mapping
        Values of `study.measures` by name.
    powers : mapping
        Mean power [W] of each of `ACCOUNTS`; empty where the scene's method keeps no accounts.
    """

    measures: Mapping[str, float]
    powers: Mapping[str, float]


def behaviour_of(scene: Scene, trials: Trials) -> Behaviour:
    """Behaviour of a robot from the first start of `VERIFYING`; times as in `trials`.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    """
    measures = measure(scene, _MEASURES, trials.settling, trials.duration, VERIFYING)
    return Behaviour(measures, _powers(scene, trials) if scene["solver.method"] == "exact" else {})


def _powers(scene: Scene, trials: Trials) -> dict[str, float]:
    device = device_at_start(scene.with_parameters({"solver.accounts": True}), VERIFYING)
    booked = []
    for time in (trials.settling, trials.settling + trials.duration):
        device.advance_to(time)
        booked.append(device.statistics["energy_accounts"])
    return {name: (booked[1][name] - booked[0][name]) / trials.duration for name in ACCOUNTS}

"""The work that the paper's misprint does: what the body gains and no mass pays."""

from typing import NamedTuple

from research.paper.readings import BEST_ANGLE, Point, Reading
from vibro_ros.simulation.simulator import Simulator


class Work(NamedTuple):
    """Energy in the first second [J]: what the motor gives net, and what reaches the body from nobody."""

    motor: float
    unpaid: float


def work_of_a_second() -> Work:
    """Energy of the first second at φ = 80° from `rest`, as printed, with the misprint.

    Raises
    ------
    SimulationError
        If the run cannot go on.
    """
    reading = Reading("exact", 0.0, "misprint", "printed", "rest", "eq5")
    device = Simulator(reading.scene(Point("angle", BEST_ANGLE)).with_parameters({"solver.accounts": True}))
    device.advance_to(1.0)
    accounts = device.statistics["energy_accounts"]
    return Work(accounts["motor_delivered"] - accounts["motor_taken_back"], accounts["unpaid"])

"""A result read again from the file that `study optimise` has written."""

import json
import math
from pathlib import Path
from typing import Any

from vibro_ros.accuracy.starts import Average
from vibro_ros.process.untrusted import content
from vibro_ros.study.optimise.plan import Plan
from vibro_ros.study.optimise.result import Result
from vibro_ros.study.optimise.search import FrontRobot
from vibro_ros.study.optimise.verification import Behaviour, Neighbourhood, Sensitivity, Verified

_LARGEST = 2**20  # B


def read_result(path: Path, plan: Plan) -> Result:
    """The result of `plan` in a file of `write_result` (OSError, ValueError)."""
    try:
        return _result(json.loads(content(path, _LARGEST)), plan)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is no result of this plan ({error}); search again") from error


def _result(whole: Any, plan: Plan) -> Result:
    space, optimum = plan.space, {name: float(value) for name, value in whole["optimum"].items()}
    around = whole["around"]
    sensitivities = tuple(Sensitivity(**one) for one in around.pop("sensitivities"))
    front = (FrontRobot(one["speed"], one["cost"], one["power"], space.scene.with_parameters(one["parameters"]))
             for one in whole["front"])
    return Result(
        plan=plan, robots=whole["robots"], best_scores=tuple(whole["best_scores"]), optimum=optimum,
        robot=space.scene.with_parameters(optimum), on_bound=tuple(space.on_bound(space.point(optimum))),
        behaviour=_behaviour(whole["behaviour"]), verified=tuple(_verified(row) for row in whole["verified"]),
        around=Neighbourhood(sensitivities=sensitivities, **around), front=tuple(front))


def _behaviour(whole: dict[str, Any]) -> Behaviour:
    return Behaviour(**{name: {one: math.nan if value is None else value for one, value in values.items()}
                        for name, values in whole.items()})


def _verified(row: dict[str, Any]) -> Verified:
    averages = {name: Average(**value) for name, value in row.items() if isinstance(value, dict)}
    return Verified(**{**row, "cost": math.nan if row["cost"] is None else row["cost"], **averages})

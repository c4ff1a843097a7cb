"""The course of a study: search, choice among the best by fresh starts, verification, perturbation."""

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import say
from vibro_ros.study.execution import Execution
from vibro_ros.study.optimise.plan import CHOOSING, Plan, values_of_many
from vibro_ros.study.optimise.search import SHOWN, Candidates, FrontRobot, front_of, searched
from vibro_ros.study.optimise.verification import (
    Behaviour,
    Neighbourhood,
    Verified,
    behaviour_of,
    case_count,
    neighbourhood,
    robot_count,
    verified,
)
from vibro_ros.study.progress import Progress

#: Parts of a search after which its best score is noted.
MILESTONES = (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Result:
    """What a study has found.

    Attributes
    ----------
    plan : Plan
        What was asked for.
    robots : int
        Number of candidates.
    best_scores : tuple of float
        Best score after each of `MILESTONES` parts of the candidates.
    optimum : mapping
        Varied parameters of the best.
    robot : Scene
        The best.
    on_bound : tuple of str
        For each variable `low`, `high` or an empty text.
    behaviour : Behaviour
        How the best moves, and where its energy goes.
    verified : tuple of Verified
        The best beside the paper's robots, from fresh starts.
    around : Neighbourhood
        The best, perturbed.
    front : tuple of FrontRobot
        Robots of which none is both faster and cheaper than another, from fresh starts; empty where energy does not
        balance.
    """

    plan: Plan
    robots: int
    best_scores: tuple[float, ...]
    optimum: Mapping[str, float]
    robot: Scene
    on_bound: tuple[str, ...]
    behaviour: Behaviour
    verified: tuple[Verified, ...]
    around: Neighbourhood
    front: tuple[FrontRobot, ...]


def studied(plan: Plan, folder: Path, execution: Execution) -> tuple[Result, Candidates]:
    """Search and verify; returns all candidates of the search as well.

    Parameters
    ----------
    plan : Plan
        What is asked for.
    folder : Path
        Of the files of the search, which goes on from them; it exists, and nobody else writes into it.
    execution : Execution
        Who computes.

    Raises
    ------
    ValueError
        If the files are another search's, or no candidate moves.
    OSError, RuntimeError
        If files cannot be read, or written.
    """
    with stage("search", plan.effort.budget) as progress:
        candidates = searched(plan, folder, execution, progress)
    scores = np.array([plan.score(values) for values in candidates.values])
    point = _chosen(plan, candidates, scores, execution)
    optimum, effort, space = plan.space.parameters(point), plan.effort, plan.space
    with stage("verification", case_count(space.scene)) as progress:
        rows = verified(space, optimum, plan.reading, effort.verifying, execution, progress)
    with stage("perturbation", robot_count(space, effort.samples)) as progress:
        around = neighbourhood(space, optimum, plan.score, effort.perturbing, effort.samples, plan.seed, execution,
                               progress)
    front: list[FrontRobot] = []
    if space.scene["effects.reaction"]:
        with stage("front", SHOWN) as progress:
            front = front_of(plan, candidates, execution, progress)
    ends = [max(1, round(part * len(scores))) for part in MILESTONES]
    return Result(plan, len(scores), tuple(float(scores[:end].max()) for end in ends), optimum, space.robot(point),
                  tuple(space.on_bound(point)), behaviour_of(space.robot(point), effort.verifying), tuple(rows), around,
                  tuple(front)), candidates


def _chosen(plan: Plan, candidates: Candidates, scores: np.ndarray, execution: Execution) -> np.ndarray:
    """The point that is best from fresh starts, of those that were best in the search: luck does not repeat."""
    scores = np.where(np.isfinite(candidates.values).all(axis=(1, 2)), scores, -np.inf)
    finalists = _apart(candidates.points, scores, plan.effort.finalists)
    trials = replace(plan.effort.choosing, first=CHOOSING)
    robots, fresh = [plan.space.robot(point) for point in finalists], []
    with stage("choice", len(robots)) as progress:
        for values in values_of_many(robots, trials, execution):
            fresh.append(plan.score(values))
            progress.add(1)
    best = int(np.argmax(fresh)) if fresh else 0
    if not fresh or fresh[best] <= 0.0:
        raise ValueError(f"--budget {plan.effort.budget}: no robot was found that goes the same way from all starts"
                         f"{' at the least speed' if plan.least_speed else ''}"
                         f"{' with so little time in the air' if plan.most_air < 1.0 else ''}; give a larger budget or "
                         "other bounds")
    return finalists[best]


def _apart(points: np.ndarray, scores: np.ndarray, count: int, distance: float = 0.05) -> list[np.ndarray]:
    """The best points of which no two are nearer than `distance` in every coordinate."""
    found: list[np.ndarray] = []
    for number in np.argsort(-scores, kind="stable"):
        if scores[number] == -np.inf:
            break
        if all(np.abs(points[number] - other).max() >= distance for other in found):
            found.append(points[number])
        if len(found) == count:
            break
    return found


@contextmanager
def stage(name: str, robots: int) -> Iterator[Progress]:
    """Show on stderr how many robots of a stage are done, and the time that is left."""
    say("study", f"{name}: {robots} robots ...")
    with Progress(name, "robot", robots) as progress:
        yield progress


def result_file(result: Result) -> bytes:
    """A result as JSON: what its tables and sentences are made of, without its plan."""
    front = [{"speed": one.speed, "cost": one.cost, "power": one.power,
              "parameters": {variable.name: one.robot[variable.name] for variable in result.plan.space.variables}}
             for one in result.front]
    whole = {"robots": result.robots, "best_scores": list(result.best_scores), "optimum": dict(result.optimum),
             "behaviour": asdict(result.behaviour), "verified": [asdict(row) for row in result.verified],
             "around": asdict(result.around), "front": front}
    return (json.dumps(_finite(whole), indent=1, allow_nan=False) + "\n").encode()


def _finite(value: Any) -> Any:
    """`value` with None for numbers that are not finite, which JSON does not know."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def scene_file(scene: Scene, comment: str) -> bytes:
    """A scene file with every parameter of `scene`, which depends on no other scene; `comment` is its first line."""
    text = yaml.safe_dump({"/**": {"ros__parameters": {"scene": "paper", **scene.parameters}}}, sort_keys=False)
    return f"# {comment}\n{text}".encode()

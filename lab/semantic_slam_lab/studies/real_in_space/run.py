"""One run in space over real pictures, and what of it is right."""

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.evaluate import evaluate
from semantic_slam.evaluation.trajectory import alignment
from semantic_slam.geometry.arrays import Array
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.shipped import configuration_file

EXISTS, FARTHEST_M = 0.5, 0.5


@dataclass(frozen=True)
class Task:
    """A bag, what is asked for in it, and where that is by given poses."""

    bag: Path
    labels: tuple[str, ...]  # () : whatever is detected
    names: tuple[str, ...]  # (O,) classes of what is there; "" : any
    positions: Array  # (O, 3) in map
    seed: int


def configuration(task: Task) -> Configuration:
    """The shipped one for space, of what is asked for."""
    base = load_configuration(configuration_file("spatial"))
    return replace(base, seed=task.seed, perception=replace(base.perception, labels=task.labels))


def outcome_of(task: Task) -> dict[str, Any]:
    """Run the bag and compare what is said to exist with what is there, paths aligned."""
    began = time.process_time()
    with tempfile.TemporaryDirectory(prefix="real_in_space_") as place:
        run_bag(task.bag, Path(place) / "beliefs", configuration(task))
        record = read_record(Path(place) / "beliefs")
    spent = time.process_time() - began
    assert record.truth is not None
    evaluation, last = evaluate(record, record.truth), record.beliefs[-1]
    aligning = alignment(evaluation.final_poses[:, :3], evaluation.true_poses[:, :3])
    rows = np.flatnonzero(last.existence > EXISTS)
    classes = [last.class_names[best] for best in last.class_probabilities[rows].argmax(axis=1)]
    stated = aligning.applied(last.object_poses[rows, :3])
    errors = matched(stated, classes, task)
    return {
        "counts": {name: classes.count(name) for name in sorted(set(task.names))} if any(task.names) else {},
        "num_objects": len(rows),
        "errors_m": errors,
        "ghosts": len(rows) - sum(error is not None for error in errors),
        "num_keyframes": len(record.beliefs),
        "ate_aligned_m": evaluation.metrics["ate_aligned_m"],
        "ate_m": evaluation.metrics["ate_m"],
        "odometry_ate_m": evaluation.metrics["dead_reckoning_ate_m"],
        "nees_mean": evaluation.metrics["nees_mean"],
        "cpu_s": spent,
    }


def matched(stated: Array, classes: list[str], task: Task) -> list[float | None]:
    """(O,) how far from each thing that is there one of its name is stated; None: none is within half a metre."""
    if not len(stated):
        return [None] * len(task.names)
    away = np.linalg.norm(task.positions[:, None] - stated[None], axis=2)
    same = np.array([[not name or name == own for own in classes] for name in task.names])
    cost = np.where(same & (away <= FARTHEST_M), away, 1e3)
    pairs = dict(zip(*linear_sum_assignment(cost), strict=True))
    near = [cost[row, pairs[row]] if row in pairs else 1e3 for row in range(len(task.names))]
    return [float(value) if value < 1e3 else None for value in near]

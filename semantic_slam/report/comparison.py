"""Runs of one bag with several configurations, side by side: the numbers of ``comparisons`` in ``report.json``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.evaluation.history import best_history
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.document import Analysis
from semantic_slam.report.log_odds import log_odds, top_two

FIRST_VIEWS = 5
"""Views of an object after which its log-odds count as the starting point: the first ones tell something new."""


@dataclass(frozen=True)
class Run:
    """One configuration and what came of it."""

    name: str
    analysis: Analysis

    @property
    def beliefs(self) -> tuple[HybridBelief, ...]:
        return self.analysis.record.beliefs

    @property
    def ate_m(self) -> float:
        """Position error of the final path [m], NaN without ground truth."""
        evaluation = self.analysis.evaluation
        value = evaluation.metrics["ate_m"] if evaluation else None
        return float("nan") if value is None else float(value)


@dataclass(frozen=True)
class Course:
    """One object in one run."""

    object_id: int
    pair: tuple[str, str]  # the main run's two likeliest classes
    values: Array  # (K,) log-odds of the first over the second, nats; infinite once one of them is pruned
    start: int | None  # place of the keyframe with the FIRST_VIEWS-th view

    @property
    def change(self) -> float:
        """Log-odds at the end less those after the first views, nats."""
        return float("nan") if self.start is None else float(self.values[-1] - self.values[self.start])

    @property
    def pruned_at(self) -> int | None:
        """Place of the keyframe from which one of the two classes has no weight left."""
        finite = np.flatnonzero(np.isfinite(self.values))
        if not np.isinf(self.values[-1]):
            return None
        return int(finite[-1]) + 1 if len(finite) else 0


def compared_objects(main: Analysis) -> list[int]:
    """Ids of the objects that the main run saw, least certain first."""
    last = main.record.beliefs[-1]
    certainty = last.class_probabilities.max(axis=1, initial=0.0)
    order = np.argsort(certainty, kind="stable")
    return [int(last.object_ids[row]) for row in order if main.detection_counts[int(last.object_ids[row])]]


def courses(main: Analysis, run: Run) -> list[Course]:
    """The log-odds of every object that the main run saw and gave two classes."""
    found = []
    for number in compared_objects(main):
        pair = top_two(main.record.beliefs, number)
        if pair is not None:
            found.append(Course(number, pair, log_odds(run.beliefs, number, pair), _start(run.analysis, number)))
    return found


def comparison_rows(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """``comparisons`` of ``report.json``: all runs, the main one first; [] where there is nothing to compare with."""
    return [_row(runs[0].analysis, run) for run in runs] if len(runs) > 1 else []


def _row(main: Analysis, run: Run) -> dict[str, Any]:
    last = run.beliefs[-1]
    return {
        "name": run.name,
        "config": run.analysis.configuration,
        "run_id": run.analysis.record.run.run_id,
        "belief_bag": run.analysis.bag["belief_bag"],
        "keyframes": [belief.keyframe for belief in run.beliefs],
        "association_entropy": [belief.association_entropy for belief in run.beliefs],
        "discarded_mass": last.discarded_mass,
        "discarded_mass_window": last.discarded_mass_window,
        "ate_m": run.ate_m,
        "objects": [_object_row(run, course) for course in courses(main, run)],
    }


def _object_row(run: Run, course: Course) -> dict[str, Any]:
    pruned, start = course.pruned_at, course.start
    return {
        "id": course.object_id,
        "classes": list(course.pair),
        "log_odds": course.values,
        "view_5_keyframe": None if start is None else run.beliefs[start].keyframe,
        "change_since_view_5": course.change,
        "pruned_at_keyframe": None if pruned is None else run.beliefs[pruned].keyframe,
        "class_probabilities": final_probabilities(run, course.object_id),
    }


def final_probabilities(run: Run, object_id: int) -> dict[str, float]:
    """Class probabilities of an object at the end of a run; {} where the run does not know it."""
    last = run.beliefs[-1]
    rows = np.flatnonzero(last.object_ids == object_id)
    return dict(zip(last.class_names, last.class_probabilities[rows[0]].tolist(), strict=True)) if len(rows) else {}


def _start(analysis: Analysis, object_id: int) -> int | None:
    """Place of the keyframe with the FIRST_VIEWS-th view of an object, under the finally best hypothesis."""
    views = 0
    for place, found in enumerate(best_history(analysis.record.beliefs)):
        views += found is not None and object_id in found
        if views == FIRST_VIEWS:
            return place
    return None

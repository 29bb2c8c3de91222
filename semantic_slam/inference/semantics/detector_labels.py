"""A detector's words as evidence: names that the objects of a hypothesis carry, whatever their heading.

Given the positions of camera and object the words of one object depend on nothing else, so that the record of its views
carries all that they tell, and their sum over classes is their evidence for the association. Names tell nothing back to
the positions.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.inference.models.detector_words import DetectorWords
from semantic_slam.inference.models.planar_observation import camera_bearing
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.viewpoint.label_model import DIRECTIONS, STEP_RAD, LabelModel, LabelRecord

LEAST_RANGE_M = 0.05
"""Nearer views count as from there."""


@dataclass(frozen=True, kw_only=True)
class _Places:
    """From where the K candidates have the camera look at each of n objects."""

    directions: Array  # (K, n) cells of the direction from object to camera, in map
    log_ranges: Array  # (K, n) of the distance in metres, in steps


class DetectorLabels:
    """Evidence of a detector's words, with what each object was called so far as its record."""

    def __init__(self, model: LabelModel) -> None:
        self._model = model

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the label model, which the kind of class models must have."""
        assert models.labels is not None
        return cls(models.labels)

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Log evidence of the words of each candidate, and the objects' records after it."""
        rows, words = given.candidates.assignments, given.step.words
        assert words is not None
        places = _places(given)
        total, records = np.zeros(len(rows)), [dict[int, ObjectViews]() for _ in range(len(rows))]
        known: dict[tuple[int, ...], tuple[float, ObjectViews]] = {}
        for number, index in enumerate(given.used.tolist()):
            for row in np.flatnonzero(rows.objects[:, number] >= 0).tolist():
                place = int(rows.objects[row, number])
                object_id = given.object_ids[place]
                before = records[row].get(object_id, given.parents[rows.parents[row]].views.get(object_id))
                seen = int(places.directions[row, number]), int(places.log_ranges[row, number])
                key = (id(before), index, place, *seen)  # hypotheses share what they have in common
                if key not in known:
                    known[key] = self._added(before, words, index, seen, given.log_class_prior[place])
                added, records[row][object_id] = known[key]
                total[row] += added
        return SemanticEvidence.of(total, records)

    def _added(
        self,
        before: ObjectViews | None,
        words: DetectorWords,
        index: int,
        seen: tuple[int, int],
        log_prior: Array,
    ) -> tuple[float, ObjectViews]:
        """Log evidence of one word of one object, and the record with it."""
        record: LabelRecord = self._model.start() if before is None else before.recent[0]
        after = self._model.after(
            record, int(words.answers[index]), words.shares[index], seen[0], STEP_RAD * float(seen[1])
        )
        log_likelihood = self._model.class_log_likelihood(after)
        earlier = np.zeros(len(log_prior)) if before is None else before.log_likelihood
        evidence = finite_log_sum_exp(log_prior + log_likelihood) - finite_log_sum_exp(log_prior + earlier)
        views = ObjectViews(
            log_likelihood=log_likelihood, mutual_information=float("nan"), in_coverage=True, recent=(after,)
        )
        return float(evidence), views


def _places(given: SemanticInput) -> _Places:
    """Rounded, so that hypotheses that agree share their work; a turn and a ratio of distances in the same steps."""
    robot, objects = _states(given)
    sensors = np.array([given.step.detections[index].sensor for index in given.used.tolist()]).reshape(-1, 2)
    count = objects.shape[1]
    directions, log_ranges = np.zeros((len(robot), count), dtype=int), np.zeros((len(robot), count), dtype=int)
    for number in range(count):
        rows = np.flatnonzero(given.candidates.assignments.objects[:, number] >= 0)
        place = np.column_stack([objects[rows, number, :2], np.zeros(len(rows))])
        bearing = camera_bearing(robot[rows], place, sensors[number])
        directions[rows, number] = np.rint(bearing / STEP_RAD).astype(int) % DIRECTIONS
        away = np.hypot(*(place[:, :2] - robot[rows, :2]).T)
        log_ranges[rows, number] = np.rint(np.log(np.maximum(away, LEAST_RANGE_M)) / STEP_RAD).astype(int)
    return _Places(directions=directions, log_ranges=log_ranges)


def _states(given: SemanticInput) -> tuple[Array, Array]:
    """(K, 3) robots and (K, n, 2 or 3) objects of the detections at the modes, of whichever weighed the candidates."""
    rows = given.candidates.assignments
    if given.candidates.problem is None:
        return rows.column("robot"), rows.column("object_states")
    stack, states = given.stack, given.stack.states(given.mode.y)
    objects = states[np.arange(len(states))[:, None], 1 + stack.slots]
    return stack.robots_of(states), objects

"""What a keyframe says of the existence of objects: detected, missed, or born."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.detection_probability import Occluders, detection_probabilities
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY, missed
from semantic_slam.inference.open_world.prediction import Prediction
from semantic_slam.inference.states.lineage import MOVES
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate

LEAST_DETECTION_SHARE = 0.02
"""Least share of the detection probability for objects detected although they seem to lie outside the region."""


def least_detected(settings: OpenWorldConfiguration) -> float:
    """The detection probability of an object that was detected is not below this."""
    return LEAST_DETECTION_SHARE * settings.detection_probability


class IfMissed(NamedTuple):
    """A parent's O objects at one candidate's mode, if they are not detected."""

    standing: Array  # (O,) probability of being detected, if it stands still
    detected: Array  # (O,) probability of being detected
    log_factor: Array  # (O,)
    existence: Array  # (O,) afterwards


class ExistenceAccounts:
    """Log factors and existence updates of the candidates of one keyframe; ``born`` (D,) ids that it would start."""

    def __init__(
        self, settings: OpenWorldConfiguration, step: Step, predictions: Sequence[Prediction], born: Index
    ) -> None:
        self._settings, self._step, self._predictions, self._born = settings, step, predictions, born

    def of(self, assignments: Assignments, object_ids: Index) -> tuple[Array, list[ExistenceUpdate]]:
        """(K,) log factors of births, detections and misses, and the updates; ``object_ids`` (K, D) as associated."""
        moves = np.zeros(object_ids.shape, dtype=bool)
        if assignments.classes is not None:
            moves = assignments.classes == MOVES
        factors = np.zeros(len(assignments))
        updates: dict[int, ExistenceUpdate] = {}
        for parent, prediction in enumerate(self._predictions):
            rows = np.flatnonzero(assignments.parents == parent)
            factors[rows] = -(self._settings.clutter_per_frame + prediction.expected_births)
            detected = self._detected(prediction, assignments.take(rows))
            at_all = prediction.detected_at_all(detected)
            log_missed, after = missed(prediction.existence, at_all)
            for at, row in enumerate(rows.tolist()):
                candidate = at if len(detected) > 1 else 0
                if_missed = IfMissed(detected[candidate], at_all[candidate], log_missed[candidate], after[candidate])
                added, updates[row] = self._account(prediction, object_ids[row], moves[row], if_missed)
                factors[row] += added
        return factors, [updates[row] for row in range(len(assignments))]

    def _detected(self, prediction: Prediction, rows: Assignments) -> Array:
        """(K, O) detection probabilities at the modes; (1, O) at the prediction where that tells as much."""
        if not prediction.is_lost and prediction.region.occluder_radius_m <= 0.0:
            return prediction.detected[None]
        ranges = np.array([detection.range_m for detection in self._step.detections], dtype=np.float64)
        bearings = np.array([detection.bearing_rad for detection in self._step.detections], dtype=np.float64)
        occluders = Occluders(ranges, bearings, self._step.free_range_scan)
        detected = np.zeros((len(rows), len(prediction.detected)))
        detected[:, prediction.in_reach] = detection_probabilities(
            prediction.region, prediction.objects, rows.column("robot"), rows.column("robot_covariance"), occluders
        )
        if prediction.detectable is not None:
            detected *= prediction.detectable / prediction.miss_runs.share
        return detected

    def _account(
        self, prediction: Prediction, association: Index, moves: Flags, if_missed: IfMissed
    ) -> tuple[float, ExistenceUpdate]:
        """Log factor and update of one candidate; (D,) objects and whether they move."""
        is_new = association >= self._born[0] if len(self._born) else np.zeros(0, dtype=bool)
        observed = prediction.component.objects.rows(association[~is_new & ~moves])
        least = least_detected(self._settings)
        stands = prediction.existence[observed] * prediction.stands[observed]
        log_detected = np.log(np.maximum(stands * np.maximum(if_missed.standing[observed], least), LEAST_PROBABILITY))
        total = float(if_missed.log_factor.sum() + (log_detected - if_missed.log_factor[observed]).sum())
        after = if_missed.existence.copy()
        after[observed] = 1.0
        new = np.flatnonzero(is_new)
        total += sum(prediction.births[n].log_area - prediction.births[n].log_stand_in for n in new)
        total += float(prediction.log_intensity[new].sum())
        if prediction.movers is not None:
            moving = prediction.movers.movers.rows(association[moves])
            factors = prediction.movers.log_detected(least, if_missed.log_factor, prediction.undecided)
            total += float(prediction.movers.log_missed.sum() + factors[moving].sum())
        kept, may_move = self._kept(prediction, association[moves], if_missed, after)
        update = ExistenceUpdate(
            existence=after,
            kept=kept,
            new_ids=association[new],
            new_existence=prediction.birth_existence[new],
            detectable=_detectable(prediction, if_missed.detected, observed, kept, len(new)),
            moving=may_move,
        )
        return total, update

    def _kept(
        self, prediction: Prediction, moving_ids: Index, if_missed: IfMissed, after: Array
    ) -> tuple[Flags, Array | None]:
        """(O,) whether objects that stand still are kept, of which some turn out to move; and whether others may."""
        if prediction.movers is None:
            return np.asarray(after >= self._settings.least_existence), None
        stands = prediction.stands * (1.0 - if_missed.standing) / (1.0 - if_missed.detected)
        kept = (after * stands >= self._settings.least_existence) & ~np.isin(
            prediction.component.objects.ids, moving_ids
        )
        return np.asarray(kept), np.asarray(1.0 - stands)


def _detectable(prediction: Prediction, detected: Array, observed: Index, kept: Flags, num_new: int) -> Array | None:
    """Whether the objects kept and the new ones can be detected in the next keyframe, where misses come in runs."""
    if prediction.detectable is None:
        return None
    seen = np.zeros(len(detected), dtype=bool)
    seen[observed] = True
    after = prediction.miss_runs.after(prediction.detectable, detected, seen)
    return prediction.miss_runs.next(np.concatenate([after[kept], np.ones(num_new)]))

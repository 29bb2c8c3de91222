"""Evidence of detections and misses in runs: the open-world forward algorithm over every object's looks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.training.detection.looks import Looks

LEAST_PROBABILITY = 1e-12


@dataclass(frozen=True, kw_only=True)
class RunLooks:
    """Looks of B runs (None where a run has none), each divided into ``num_stretches`` stretches."""

    runs: Sequence[Looks | None]  # B
    num_stretches: int  # F

    @property
    def num_in_view(self) -> int:
        """Number of looks at known objects that are probably in view."""
        return sum(own.num_in_view for own in self.runs if own is not None)

    @property
    def of_one_view(self) -> bool:
        """Whether no two runs have different fields of view, as needed to compare directions."""
        return len(self._fields_of_view) <= 1

    @property
    def field_of_view_rad(self) -> float:
        """The field of view of runs :attr:`of_one_view`."""
        (width,) = self._fields_of_view
        return width

    @property
    def _fields_of_view(self) -> set[float]:
        return {own.field_of_view_rad for own in self.runs if own is not None}

    def log_evidence(self, rates: DetectionRates, shares: Array | None = None) -> Array:
        """(B, F, G) log evidence of each stretch given the earlier ones; ``shares``: see :func:`log_evidence`."""
        width = len(rates) if shares is None else max(len(rates), shares.shape[1])
        found = np.zeros((len(self.runs), self.num_stretches, width))
        for number, looks in enumerate(self.runs):
            if looks is not None:
                logs = log_evidence(looks, rates, shares)
                stretches = np.array_split(np.arange(len(logs)), self.num_stretches)
                found[number] = [logs[rows].sum(axis=0) for rows in stretches]
        return found


def log_evidence(looks: Looks, rates: DetectionRates, shares: Array | None = None) -> Array:
    """(K, G) log evidence of the detections and misses in each keyframe, given the earlier ones.

    ``shares`` (NUM_DIRECTIONS, G) or (NUM_DIRECTIONS, 1) of the detection probability, in place of those of ``rates``.
    """
    by_direction = rates.by_direction.at(looks.off_centre_rad)[..., None] if shares is None else looks.hats @ shares
    width = max(len(rates), by_direction.shape[2])
    found = np.zeros((len(looks.in_view), width))
    detectable = np.ones((looks.in_view.shape[1], width))
    for keyframe, known in enumerate(looks.is_known):
        rows = np.flatnonzero(known)
        seen, next_one = looks.is_detected[keyframe, rows], rates.runs.next(detectable[rows])
        chance = looks.in_view[keyframe, rows, None] * rates.runs.hit * rates.fall_off(looks.ranges_m[keyframe, rows])
        detected = chance * by_direction[keyframe, rows] * next_one
        logs = np.log(np.maximum(np.where(seen[:, None], detected, 1.0 - detected), LEAST_PROBABILITY))
        found[keyframe] = looks.weights[rows] @ logs
        detectable[rows] = rates.runs.after(next_one, detected, seen)
    return found

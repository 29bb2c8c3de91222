"""Detections of known objects, of K candidates: where the objects are then, and what each detection says of the place.

The weight of such a pair is its density times the detection probability, averaged over robot and object given the
pair. Given the detection, the place relative to the robot is about as well known as the detection is accurate, however
little the map knew of it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.open_world.margins import NOT_DETECTED, Places
from semantic_slam.inference.states.in_view import InViewProbabilities, InViewRecord, PredictedDetections
from semantic_slam.inference.states.miss_runs import MissRuns


class SeenAgain(NamedTuple):
    """n pairs of a candidate and an object in reach that it associates with a detection."""

    candidates: Index  # (n,)
    columns: Index  # (n,) among the objects in reach
    detections: Index  # (n,) numbers of the detections, which do not hide the objects that they are of
    points: Array  # (n, d) places in the body frame, at the candidates' modes
    slopes: Array  # (n, m, d) Jacobians of the detections' whitened residuals by these
    at_modes: bool  # whether they are weighed at the modes: a learned region ends where detections do, errors included

    def predicted(
        self,
        places: Places,
        record: InViewRecord,
        runs: MissRuns,
        in_view: Callable[[Places, Array, Index], tuple[InViewProbabilities, Array]],
        chance: Callable[[Array], Array],
    ) -> tuple[PredictedDetections, Array]:
        """What K candidates detect of N objects at ``places`` (K, N), and (n, G) probabilities to see the pairs.

        ``in_view`` gives the overlap of some places, whose objects nothing occluded before with some probability, and
        the probability that nothing but their own detections, by number, occludes them now; ``chance`` the detection
        probabilities in view, by the points.
        """
        shape, pairs, some = places.points.shape[:-1], (self.candidates, self.columns), record.take(self.columns)
        detected_as = np.full(shape, NOT_DETECTED)
        detected_as[pairs] = self.detections
        if self.at_modes:
            predicted = record.predicted(*in_view(places, record.unoccluded, detected_as), chance(places.points), runs)
            return predicted, predicted.detected[pairs]
        every = places.flat_with(places.at(*pairs).measured(self.points, self.slopes))
        before = np.concatenate([np.tile(record.unoccluded, shape[0]), some.unoccluded])
        overlap, unoccluded = in_view(every, before, np.concatenate([detected_as.ravel(), self.detections]))
        count = shape[0] * shape[1]
        expected = InViewProbabilities(*(own[:count].reshape(shape) for own in overlap))
        found = InViewProbabilities(*(own[count:] for own in overlap))
        predicted = record.predicted(expected, unoccluded[:count].reshape(shape), chance(places.points), runs)
        return predicted, some.seen(expected.at(*pairs), found, chance(self.points), runs)

"""Existence of the objects of one hypothesis after a keyframe, as one candidate associates the detections."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY, existence_after_miss, log_miss
from semantic_slam.inference.open_world.prediction.nearby import in_view_of
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.states.in_view import InViewRecord, PredictedDetections
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate


@dataclass(frozen=True, kw_only=True)
class CandidateExistence:
    """The account of one candidate, whose parent has O objects.

    Of its D detections m are of objects that stand still, and n are first detections (births).
    """

    prediction: Prediction
    settings: OpenWorldConfiguration
    predicted: PredictedDetections  # K = 1, of the objects in reach if they stand still, under each distinct sensor
    standing: Array  # (O, G) detection probabilities of what stands still
    detected: Array  # (O, G) detection probabilities
    log_missed: Array  # (O, G) log probabilities of missing each object
    observed: Index  # (m,) rows of the objects detected that stand still
    seen_by: Index  # (m,) their detections
    found: Array  # (m, G) their detection probabilities given these
    moving_ids: Index  # ids of the objects detected that move
    new: Index  # (n,) detections that are births
    new_ids: Index  # (n,)
    log_weights: Array  # (G,) log weights of the sensor settings after this keyframe

    def update(self) -> ExistenceUpdate:
        """The existence update of the parent's objects, under the sensor settings that keep enough weight."""
        prediction = self.prediction
        rates, left = prediction.rates.reweighed(self.log_weights)
        existence = existence_after_miss(prediction.existence, self.detected)[:, left]
        existence[self.observed] = 1.0
        stands = self._stands[:, left]
        gone = self._gone(left)
        probable = rates.average(existence)
        if prediction.movers is not None:
            probable = rates.average(existence * stands)
            probable[self.observed] = 1.0
        if gone is not None:
            probable = probable + rates.average(gone)
        kept = (probable >= self.settings.least_existence) & ~np.isin(prediction.component.objects.ids, self.moving_ids)
        return ExistenceUpdate(
            existence=existence,
            kept=np.asarray(kept),
            new_ids=self.new_ids,
            new_existence=prediction.birth_existence[np.ix_(self.new, np.flatnonzero(left))],
            rates=rates,
            rates_kept=None if left.all() else left,
            in_view=self._in_view(kept).with_rates(left),
            gone=gone,
            stamp_ns=prediction.population.stamp_ns,
            moving=None if prediction.movers is None else 1.0 - stands,
            track_scores=self._track_scores[:, left],
        )

    @property
    def _stands(self) -> Array:
        """(O, G) probability that an object stands still, if it exists and was missed."""
        return np.asarray(self.prediction.stands * (1.0 - self.standing) / (1.0 - self.detected))

    @property
    def _track_scores(self) -> Array:
        """(O, G) track scores, those of detected objects without the density of their detections."""
        prediction, seen = self.prediction, self.observed
        population = prediction.population
        assert population.track_scores is not None
        gone = 0.0 if population.gone is None else population.gone
        there = prediction.existence / np.maximum(prediction.existence + gone, LEAST_PROBABILITY)  # if it is a thing
        after = population.track_scores + log_miss(there, self.detected)
        found = there[seen] * prediction.stands[seen] * np.maximum(self.found, prediction.least_detected)
        after[seen] = population.track_scores[seen] + np.log(np.maximum(found, LEAST_PROBABILITY))
        after[seen] -= prediction.log_false_alarm[self.seen_by]
        return np.asarray(after)

    def _gone(self, left: Flags) -> Array | None:
        """(O, G) probability that an object has left, which a miss makes likelier; None: objects do not leave."""
        before = self.prediction.population.gone
        if before is None:
            return None
        gone = before[:, left] * np.exp(-self.log_missed[:, left])
        gone[self.observed] = 0.0
        return np.asarray(gone)

    def _in_view(self, kept: Flags) -> InViewRecord:
        """What is known of being in view, of the objects ``kept`` (O,), then of the new ones."""
        prediction = self.prediction
        (sensors, which), runs, reach = prediction.rates.sensors, prediction.rates.runs, prediction.in_reach
        seen = np.zeros(len(prediction.existence), dtype=bool)
        seen[self.observed] = True
        in_reach = self.predicted.after(seen[reach], sensors.runs).with_rates(which)
        all_objects = in_view_of(prediction.population).unreached(runs).updated(reach, in_reach)
        return all_objects.take(kept).joined(all_objects.started(len(self.new), runs))

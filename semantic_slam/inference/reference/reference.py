"""The null (reference) model, which explains nothing: uniform detections with class-independent scores.

Every detection lies anywhere in the sensor's region with equal density. The model's log density of a keyframe is in the
units of the belief's log evidence, so that both are comparable: positions per metre and radian (in space per metre and
square radian), like false alarms (clutter); class scores under one Gaussian with the moments of all classes seen from
all sides, tempered like the class models. Whatever a belief counts besides densities, the null model counts in the same
way:

- open world (births, misses, clutter): the number of detections is geometric, with the mean that the configuration
  expects where nothing was seen yet; densities are of sets, as those of the Poisson multi-Bernoulli mixture. The region
  is the learned one where the belief learns it, and like there it contains the detections that it is learned from.
  Measurements of gravity are those of a robot that dead reckons with them.
- known map: Eq. 4.18 weighs each assignment of the detections to visible objects with P(beta | x, O) = 1, so that the
  null model counts once for each of them.
- given identities: an object named for the first time has the broad prior that the belief gives it, which carries no
  information.
"""

from collections.abc import Iterable, Sequence
from typing import ClassVar

import numpy as np
from scipy.special import gammaln

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.reference.places import EvenPlaces
from semantic_slam.inference.reference.scores import KeyframeScores
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.world.identities import objects_by_identity
from semantic_slam.inference.world.objects import ObjectEntry


class Reference:
    """The null model of one run. It is stateful: give it every keyframe once, in order."""

    STATE: ClassVar[tuple[str, ...]] = ("_named",)

    def __init__(
        self,
        configuration: Configuration,
        objects: Iterable[ObjectEntry],
        places: EvenPlaces,
        scores: KeyframeScores,
    ) -> None:
        """``objects`` are those of the map prior."""
        self._configuration, self._places, self._scores = configuration, places, scores
        self._association = strategy_of(configuration)
        self._rates = DetectionRates.of(configuration.open_world)
        self._named = set(objects_by_identity({entry.object_id: entry.name for entry in objects}))

    def log_density(self, step: Step, belief: HybridBelief) -> float:
        """Log density of the step's detections, in nats; ``belief`` is the posterior after them.

        NaN for detections of a kind for which no region is defined.
        """
        motion = self._places.log_motion(step)
        if not self._places.suits(step.detections):
            return np.nan
        if self._association.wants_identities:
            return self._given(step) + motion
        if self._association.needs_map:
            return self._mapped(step, belief) + motion
        places = self._places.reaching(step)
        every = range(len(step.detections))
        return (
            self._evenly(step, every, places)
            + self._log_count(len(every), places.expected_births(self._rates))
            + motion
        )

    def _given(self, step: Step) -> float:
        """Given identities: uniform for known objects; under its broad prior for one named for the first time."""
        known, new = list[int](), list[int]()
        seen: set[str] = set()
        for number, name in enumerate(step.names):
            if name:
                (known if name in self._named else new).append(number)
                seen.add(name)
        self._named |= seen
        first = [step.detections[number] for number in new]
        by_prior = sum(map(self._places.log_density_of_first, first))
        return self._evenly(step, known, self._places) + self._scores.log_density(first) + by_prior

    def _mapped(self, step: Step, belief: HybridBelief) -> float:
        """Known map: the used detections, uniform, counted once for each assignment of them to visible objects."""
        distinct, count = self._configuration.distinct_assignment, len(belief.object_ids)
        used = np.argsort(-step.scores, kind="stable")[: count if distinct else None]
        visible = max(self._places.num_visible(belief), float(len(used)))
        assignments = gammaln(visible + 1.0) - gammaln(visible - len(used) + 1.0)
        if not distinct:
            assignments = len(used) * np.log(visible)
        return self._evenly(step, used.tolist(), self._places) + float(assignments)

    def _evenly(self, step: Step, used: Sequence[int], places: EvenPlaces) -> float:
        """Log density of detections uniform over the region, with class-independent scores."""
        scores = self._scores.log_density([step.detections[number] for number in used])
        return places.log_density(step, used) + scores

    def _log_count(self, count: int, births: Array) -> float:
        """Log of n! P(n), the cardinality term of a set density, beside the density of each detection.

        P(n) is geometric, averaged over the sensor settings that evidence is to decide between; ``births`` (G,) are the
        first detections expected where nothing was seen yet.
        """
        mean = self._rates.clutter_per_frame + births
        log_counts = count * np.log(mean) - (count + 1.0) * np.log1p(mean)
        return float(gammaln(count + 1.0) + np.logaddexp.reduce(log_counts) - np.log(len(mean)))

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
- known map: Eq. 4.18 weighs each assignment of the detections to visible objects with P(beta | x, O) = 1, and clutter
  with its rate. The null model is of the detections that the belief associates, and counts with the sum of these
  weights, so that both have the same integral over all measurements of that many detections.
- given identities: an object named for the first time has the broad prior that the belief gives it, which carries no
  information.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from scipy.special import gammaln

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.association.used_detections import used_detections
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.reference.assignment_count import log_num_assignments
from semantic_slam.inference.reference.places import EvenPlaces
from semantic_slam.inference.reference.scores import KeyframeScores
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.world.identities import objects_by_identity
from semantic_slam.inference.world.problem import Problem


class Reference:
    """The null model of one run. It is stateful: give it every keyframe once, in order."""

    STATE: ClassVar[tuple[str, ...]] = ("_named", "_uncertain")

    def __init__(
        self, configuration: Configuration, problem: Problem, places: EvenPlaces, scores: KeyframeScores
    ) -> None:
        """``problem`` is that of the run; ``configuration`` also has what it leaves out of the sensor's settings."""
        self._configuration, self._problem, self._places, self._scores = configuration, problem, places, scores
        self._association = strategy_of(configuration)
        self._rates = DetectionRates.of(configuration.open_world)
        twins = problem.displaced.on_map
        names = {entry.object_id: entry.name for entry in problem.objects if entry.object_id not in twins}
        self._named = set(objects_by_identity(names))
        self._uncertain = _uncertain_existence(problem)  # before the next keyframe

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
        """Known map: the detections that are associated, uniform, with the weights of their assignments.

        Objects whose existence the belief weighs exist as they did before this keyframe.
        """
        problem = self._problem
        clutter, used = problem.clutter_rate, used_detections(problem, step)
        visible = belief.object_ids[self._places.visible(belief)].tolist()
        uncertain = np.array([self._uncertain[n] for n in visible if n in self._uncertain])
        num_certain = len(visible) - len(uncertain)
        if clutter <= 0.0:  # all of them are of objects, which are then visible
            num_certain = max(num_certain, len(used) - len(uncertain))
        existence = dict(zip(belief.object_ids.tolist(), np.minimum(belief.existence, 1.0).tolist(), strict=True))
        self._uncertain = {n: existence[n] for n in self._uncertain}
        assignments = log_num_assignments(len(used), num_certain, uncertain, clutter, problem.distinct)
        return self._evenly(step, used.tolist(), self._places) + assignments

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


def _uncertain_existence(problem: Problem) -> dict[int, float]:
    """Prior existence probability of the objects for whose first detection the belief charges it, by id.

    They are placeholders of unmapped objects and, where objects may be displaced, those of the map with their twins.
    """
    existence, twins = {entry.object_id: entry.existence for entry in problem.objects}, problem.displaced.elsewhere
    placeholders = {number: existence[number] for number in problem.unmapped_ids}
    return placeholders | {own: existence[own] + existence[other] for own, other in twins.items()}

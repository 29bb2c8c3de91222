"""Detection, clutter and birth rates as a discrete mixture within each hypothesis, weighted by its evidence.

Given one setting of the rates, the existences of the objects of a history are independent. A hypothesis is the mixture
over all settings, each with the weight that the detections, misses and births so far give it: the sum over settings is
exact, and needs no additional hypotheses.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any, Self

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.states.direction_shares import ALIKE, DirectionShares
from semantic_slam.inference.states.miss_runs import MissRuns

NAMES = {
    "open_world.detection_probability": "probability",
    "open_world.detection_half_range_m": "half_range_m",
    "open_world.miss_persistence": "persistence",
    "open_world.clutter_per_frame": "clutter_per_frame",
    "open_world.birth_density": "birth_density",
}
"""Name in the configuration -> field of :class:`DetectionRates`."""


@dataclass(frozen=True, kw_only=True)
class DetectionRates:
    """G settings of the rates, with their weights."""

    probability: Array  # (G,) of detecting an unoccluded object in the region, at zero range
    half_range_m: Array  # (G,) range at which that probability is halved; inf: no decrease within the region
    birth_density: Array  # (G,) objects per square metre
    clutter_per_frame: Array  # (G,) expected false alarms per frame
    persistence: Array  # (G,) correlation of an object's detectability between keyframes, see ``MissRuns``
    log_weights: Array = field(default_factory=lambda: np.zeros(1))  # (G,) normalised
    by_direction: DirectionShares = ALIKE  # dependence on the bearing, common to all settings
    least_log_weight: float = -np.inf  # settings of smaller weight are dropped for good

    @classmethod
    def of(cls, settings: OpenWorldConfiguration) -> Self:
        """All combinations of the configured values, with equal weights."""
        grid = product(
            settings.detection_probabilities or (settings.detection_probability,),
            settings.detection_half_ranges_m or (np.inf,),
            settings.miss_persistences or (settings.miss_persistence,),
            settings.birth_densities or (settings.birth_density,),
            settings.clutters_per_frame or (settings.clutter_per_frame,),
        )
        probability, half_range, persistence, density, clutter = np.array(list(grid)).T
        return cls(
            probability=probability,
            half_range_m=half_range,
            birth_density=density,
            clutter_per_frame=clutter,
            persistence=persistence,
            log_weights=np.full(len(density), -np.log(len(density))),
            by_direction=DirectionShares.of(settings),
            least_log_weight=-float(np.log(settings.rates_ratio)),
        )

    def __len__(self) -> int:
        return len(self.log_weights)

    @cached_property
    def weights(self) -> Array:
        """(G,) weights, which sum to one."""
        return np.exp(self.log_weights)

    @cached_property
    def runs(self) -> MissRuns:
        """The Markov chains of detectability, one for each of the G settings."""
        return MissRuns(self.probability, self.persistence)

    @property
    def misses_in_runs(self) -> bool:
        """Whether an object's detectability is correlated between keyframes, under some setting."""
        return bool((self.persistence > 0.0).any())

    def fall_off(self, ranges_m: Array) -> Array:
        """(..., G) detection probabilities at (...,) ranges, as shares of those at the sensor.

        Half-normal, as in distance sampling (Buckland et al. 2001, Introduction to Distance Sampling, Sec. 2.3).
        """
        return np.asarray(np.exp2(-np.square(np.asarray(ranges_m)[..., None] / self.half_range_m)))

    @cached_property
    def sensors(self) -> "tuple[DetectionRates, Index]":
        """The P distinct settings of the detection model alone, and (G,) the index of each setting among them."""
        if len(self) == 1:
            return self, np.zeros(1, dtype=int)
        rows, numbers = self._by_sensor
        return self.take(rows), numbers

    @property
    def sensor_rows(self) -> Index:
        """(P,) the first of the settings under each of the distinct ``sensors``."""
        return self._by_sensor[0]

    @cached_property
    def _by_sensor(self) -> tuple[Index, Index]:
        """(P,) the first setting of each distinct detection model, and (G,) the model's number for each setting.

        Equal ones are neighbours once sorted: many times faster than ``np.unique`` over columns.
        """
        order = np.lexsort((self.persistence, self.half_range_m, self.probability))
        model = np.stack([self.probability, self.half_range_m, self.persistence])[:, order]
        begins = np.ones(len(self), dtype=bool)
        begins[1:] = (model[:, 1:] != model[:, :-1]).any(axis=0)
        numbers = np.empty(len(self), dtype=int)
        numbers[order] = np.cumsum(begins) - 1
        return order[begins], numbers

    def average(self, values: Array) -> Array:
        """(...,) weighted means of (..., G) over the settings."""
        return np.asarray(values @ self.weights)

    def moments(self, name: str) -> tuple[float, float]:
        """Mean and standard deviation over the settings of the field ``name``; of an infinite mean it is NaN."""
        values = getattr(self, name)
        mean = float(self.average(values))
        if not np.isfinite(mean):
            return mean, np.nan
        return mean, float(np.sqrt(self.average((values - mean) ** 2)))

    def explained(self, log_factors: Array) -> tuple[Array, Array]:
        """Bayes update by data of (..., G) log likelihoods.

        Their (...,) log evidence, and the (..., G) normalised log weights.
        """
        joint = self.log_weights + log_factors
        total = np.logaddexp.reduce(joint, axis=-1, keepdims=True)
        return total[..., 0], joint - total

    def reweighed(self, log_weights: Array) -> tuple[Self, Flags]:
        """The settings with (G,) new weights, and flags (G,) of those that were not dropped."""
        if len(self) == 1:
            return self, np.ones(1, dtype=bool)
        kept = log_weights >= self.least_log_weight
        left = log_weights[kept]
        return replace(self.take(np.flatnonzero(kept)), log_weights=left - np.logaddexp.reduce(left)), kept

    def take(self, rows: Index) -> Self:
        """Some of the settings, with their weights as they are (not normalised)."""
        some: dict[str, Any] = {name: getattr(self, name)[rows] for name in (*NAMES.values(), "log_weights")}
        return replace(self, **some)


CERTAIN = DetectionRates(
    probability=np.ones(1),
    half_range_m=np.full(1, np.inf),
    birth_density=np.zeros(1),
    clutter_per_frame=np.zeros(1),
    persistence=np.zeros(1),
)
"""A single setting with certain detection, for worlds in which misses do not count."""

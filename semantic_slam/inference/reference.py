"""A model that explains nothing: every detection lies anywhere in the sensor's region, and has the scores of no class.

Its log density of a keyframe is in the units of the belief's log evidence, so that the two compare: places by metre and
radian, as false alarms'; class scores by one Gaussian with the moments of all classes seen from all around, tempered as
theirs are. What a belief counts besides densities, the reference counts alike:

- objects that come and go: the number of detections is geometric, with the mean that the configuration expects where
  nothing was seen yet; densities are of sets, as those of the Poisson multi-Bernoulli mixture. The region is the
  learned one where the belief learns it, and like there it holds the detections that it is learned from.
- a known map: Eq. 4.18 weighs each assignment of the detections to visible objects with P(beta | x, O) = 1, so that the
  reference counts once for each of them.
- given identities: an object named for the first time has the broad prior that the belief gives it, which says nothing.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from scipy.special import gammaln

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, broadcast_copy
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.planar.region import SensorRegion, sensor_region
from semantic_slam.inference.open_world.planar.unseen_ground import first_detections
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints, log_density

NUM_AZIMUTHS = 36
"""Directions around an object, evenly spread, over which class models are averaged."""
NUM_DESCRIPTORS = 64
"""Draws of descriptors from their prior over which a learned likelihood is averaged."""


class KeyframeScores(Protocol):
    """What the reference says of the semantics of detections."""

    def log_density(self, detections: Sequence[PlanarDetection]) -> float:
        """Log density of those of all detections, in nats."""


@dataclass(frozen=True)
class EvenWords:
    """A detector's words, of which every one is as likely."""

    num_words: int

    def log_density(self, detections: Sequence[PlanarDetection]) -> float:
        """Log probability of the words of all detections, whatever they are, in nats."""
        return -len(detections) * float(np.log(self.num_words))


@dataclass(frozen=True)
class ScoreDensity:
    """A Gaussian over semantic features of F components that knows no class; of no components: none are compared."""

    mean: Array  # (F,)
    covariance: Array  # (F, F)
    tempering: float = 1.0  # densities count with its inverse as their power

    @classmethod
    def matched(cls, means: Array, covariances: Array, tempering: float) -> Self:
        """With the moments of the even mixture of B Gaussians (B, F), (B, F, F)."""
        spread = np.cov(means, rowvar=False, bias=True).reshape(covariances.shape[1:])
        return cls(means.mean(axis=0), covariances.mean(axis=0) + spread, tempering)

    @classmethod
    def of_classes(cls, model: ViewpointModel, tempering: float) -> Self:
        """All classes, seen from all around at one metre."""
        classes = np.repeat(np.arange(len(model.class_names)), NUM_AZIMUTHS)
        prediction = model.predict(classes, _all_around(len(model.class_names)))
        return cls.matched(prediction.mean, prediction.covariance, tempering)

    @classmethod
    def of_descriptors(cls, latent: LatentObservation) -> Self:
        """Descriptors drawn from their prior, seen from all around."""
        normals = np.random.default_rng(0).standard_normal((NUM_DESCRIPTORS, latent.num_dimensions))
        draws = latent.prior.mean + latent.prior.sigma * normals
        prediction = latent.model.predict(_all_around(len(draws)), np.repeat(draws, NUM_AZIMUTHS, axis=0))
        return cls.matched(
            prediction.mean, np.eye(prediction.sigma.shape[1]) * prediction.sigma[:, None] ** 2, latent.tempering
        )

    def log_density(self, detections: Sequence[PlanarDetection]) -> float:
        """Log density of the features of all detections, in nats."""
        if not len(self.mean) or not detections:
            return 0.0
        features = np.array([detection.feature for detection in detections])
        covariances = np.array([detection.feature_covariance for detection in detections])
        return float(log_density(features - self.mean, self.covariance + covariances).sum()) / self.tempering


NO_SCORES = ScoreDensity(np.zeros(0), np.zeros((0, 0)))


class Reference:
    """The reference model of one run; it is told every keyframe once, in turn."""

    def __init__(self, configuration: Configuration, objects: Iterable[ObjectEntry], scores: KeyframeScores) -> None:
        """``objects`` are those of the map prior."""
        self._configuration, self._scores = configuration, scores
        self._association = strategy_of(configuration)
        self._region = _region(configuration, is_open=self._association.tracks_objects)
        self._rates = DetectionRates.of(configuration.open_world)
        self._named = {name for entry in objects for name in (entry.name, str(entry.object_id))}

    def log_density(self, step: Step, belief: HybridBelief) -> float:
        """Log density of the step's detections, in nats; ``belief`` is that after them.

        NaN for detections that are not range and bearing in the plane: what region they fill is not known.
        """
        if not all(isinstance(detection, PlanarDetection) for detection in step.detections):
            return np.nan
        if self._association.wants_identities:
            return self._given(step)
        if self._association.needs_map:
            return self._mapped(step, belief)
        region = self._region.reaching(step.sensed)
        return self._evenly(step.detections, region) + self._log_count(len(step.detections), region)

    def _given(self, step: Step) -> float:
        """Detections of known objects lie anywhere; what is named for the first time is where its prior has it."""
        known, new = list[PlanarDetection](), list[PlanarDetection]()
        seen: set[str] = set()
        for detection, name in zip(step.detections, step.names, strict=True):
            if name:
                (known if name in self._named else new).append(detection)
                seen.add(name)
        self._named |= seen
        return self._evenly(known, self._region) + self._scores.log_density(new) + sum(map(self._under_prior, new))

    def _mapped(self, step: Step, belief: HybridBelief) -> float:
        """The detections that take part, once for each of their assignments to objects in sight."""
        distinct, count = self._configuration.distinct_assignment, len(belief.object_ids)
        used = np.argsort(-step.scores, kind="stable")[: count if distinct else None]
        visible = max(self._num_visible(belief), float(len(used)))
        assignments = gammaln(visible + 1.0) - gammaln(visible - len(used) + 1.0)
        if not distinct:
            assignments = len(used) * np.log(visible)
        return self._evenly([step.detections[i] for i in used], self._region) + float(assignments)

    def _num_visible(self, belief: HybridBelief) -> float:
        """Expected number of the map's objects in sight of the heaviest hypothesis."""
        limits = self._configuration.visibility
        if limits.max_range_m <= 0.0 and limits.field_of_view_rad <= 0.0:
            return float(len(belief.object_ids))
        objects = np.array([planar_from_pose_vector(pose) for pose in belief.object_poses])
        robot = planar_from_pose_vector(belief.poses[0])
        relative = se2.between(broadcast_copy(robot, objects.shape), objects)[:, :2]
        return float(self._region.contains(relative, np.zeros((len(relative), 2, 2))).sum())

    def _evenly(self, detections: Sequence[PlanarDetection], region: SensorRegion) -> float:
        """Places even over the region's area: a range of r has the density r / area; and the scores of no class."""
        ranges = [detection.range_m for detection in detections if detection.has_range]
        bearings = len(detections) - len(ranges)
        places = float(np.log(ranges).sum()) - len(ranges) * np.log(region.area_m2)
        return float(places) - bearings * float(np.log(region.field_of_view_rad)) + self._scores.log_density(detections)

    def _under_prior(self, detection: PlanarDetection) -> float:
        """Log density of a first detection under its object's broad prior, which is centred on it."""
        new = self._configuration.new_objects
        if not detection.has_range:
            across = min(new.range_m, new.sigma_position_m) / new.range_m
            return -0.5 * float(np.log(2.0 * np.pi * (across**2 + detection.covariance[1, 1])))
        spread = np.diag([1.0, detection.range_m**-2]) * new.sigma_position_m**2 + detection.covariance
        return -0.5 * float(np.linalg.slogdet(2.0 * np.pi * spread)[1])

    def _log_count(self, count: int, region: SensorRegion) -> float:
        """Log of n! P(n), which a density of sets counts besides that of each detection.

        Averaged over the settings of the sensor between which evidence is to decide, where nothing was seen before.
        """
        nothing = np.zeros((0, 3)), np.zeros(3), np.zeros((0, 2))
        births, _ = first_detections(region, self._rates, *nothing, 1.0)
        mean = self._rates.clutter_per_frame + births
        log_counts = count * np.log(mean) - (count + 1.0) * np.log1p(mean)
        return float(gammaln(count + 1.0) + np.logaddexp.reduce(log_counts) - np.log(len(mean)))


def _region(configuration: Configuration, *, is_open: bool) -> SensorRegion:
    """The region where an open world expects detections; in a closed one all that is visible, or has a depth."""
    region, limits = sensor_region(configuration.open_world), configuration.visibility
    if is_open:
        return region
    return SensorRegion(
        min_range_m=0.0,
        max_range_m=limits.max_range_m or configuration.perception.max_depth_m or region.max_range_m,
        field_of_view_rad=limits.field_of_view_rad or 2.0 * np.pi,
    )


def _all_around(count: int) -> Viewpoints:
    """Viewpoints (count x azimuths) around ``count`` objects, each from everywhere at one metre."""
    azimuth = np.tile(np.linspace(-np.pi, np.pi, NUM_AZIMUTHS, endpoint=False), count)
    return Viewpoints(azimuth, np.zeros(len(azimuth)), np.ones(len(azimuth)))

"""The null (reference) model, which explains nothing: uniform detections with class-independent scores.

Every detection lies anywhere in the sensor's region with equal density. The model's log density of a keyframe is in the
units of the belief's log evidence, so that both are comparable: positions per metre and radian, like false alarms
(clutter); class scores under one Gaussian with the moments of all classes seen from all sides, tempered like the class
models. Whatever a belief counts besides densities, the null model counts in the same way:

- open world (births, misses, clutter): the number of detections is geometric, with the mean that the configuration
  expects where nothing was seen yet; densities are of sets, as those of the Poisson multi-Bernoulli mixture. The region
  is the learned one where the belief learns it, and like there it contains the detections that it is learned from.
- known map: Eq. 4.18 weighs each assignment of the detections to visible objects with P(beta | x, O) = 1, so that the
  null model counts once for each of them.
- given identities: an object named for the first time has the broad prior that the belief gives it, which carries no
  information.
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
"""Number of evenly spaced azimuths around an object over which class models are averaged."""
NUM_DESCRIPTORS = 64
"""Number of descriptors drawn from their prior over which a learned likelihood is averaged."""


class KeyframeScores(Protocol):
    """The null model's density of the semantic measurements."""

    def log_density(self, detections: Sequence[PlanarDetection]) -> float:
        """Log density of the semantic measurements of all detections, in nats."""


@dataclass(frozen=True)
class EvenWords:
    """A uniform distribution over the words of a detector: its labels, and one word for any other label."""

    num_words: int

    def log_density(self, detections: Sequence[PlanarDetection]) -> float:
        """Log probability of the words of all detections, in nats; it depends on their number alone."""
        return -len(detections) * float(np.log(self.num_words))


@dataclass(frozen=True)
class ScoreDensity:
    """A class-independent Gaussian over semantic features of F components; F = 0: features are not compared."""

    mean: Array  # (F,)
    covariance: Array  # (F, F)
    tempering: float = 1.0  # densities are raised to the power of its inverse

    @classmethod
    def matched(cls, means: Array, covariances: Array, tempering: float) -> Self:
        """Moment match the equally weighted mixture of B Gaussians, means (B, F) and covariances (B, F, F)."""
        spread = np.cov(means, rowvar=False, bias=True).reshape(covariances.shape[1:])
        return cls(means.mean(axis=0), covariances.mean(axis=0) + spread, tempering)

    @classmethod
    def of_classes(cls, model: ViewpointModel, tempering: float) -> Self:
        """Match the mixture of all classes, seen from all azimuths at one metre."""
        classes = np.repeat(np.arange(len(model.class_names)), NUM_AZIMUTHS)
        prediction = model.predict(classes, _all_around(len(model.class_names)))
        return cls.matched(prediction.mean, prediction.covariance, tempering)

    @classmethod
    def of_descriptors(cls, latent: LatentObservation) -> Self:
        """Match the mixture of descriptors drawn from their prior, seen from all azimuths at one metre."""
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
    """The null model of one run. It is stateful: give it every keyframe once, in order."""

    def __init__(self, configuration: Configuration, objects: Iterable[ObjectEntry], scores: KeyframeScores) -> None:
        """``objects`` are those of the map prior."""
        self._configuration, self._scores = configuration, scores
        self._association = strategy_of(configuration)
        self._region = _region(configuration, is_open=self._association.tracks_objects)
        self._rates = DetectionRates.of(configuration.open_world)
        self._named = {name for entry in objects for name in (entry.name, str(entry.object_id))}

    def log_density(self, step: Step, belief: HybridBelief) -> float:
        """Log density of the step's detections, in nats; ``belief`` is the posterior after them.

        NaN for detections that are not range and bearing in the plane, for which no region is defined.
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
        """Given identities: uniform for known objects; under its broad prior for one named for the first time."""
        known, new = list[PlanarDetection](), list[PlanarDetection]()
        seen: set[str] = set()
        for detection, name in zip(step.detections, step.names, strict=True):
            if name:
                (known if name in self._named else new).append(detection)
                seen.add(name)
        self._named |= seen
        return self._evenly(known, self._region) + self._scores.log_density(new) + sum(map(self._under_prior, new))

    def _mapped(self, step: Step, belief: HybridBelief) -> float:
        """Known map: the used detections, uniform, counted once for each assignment of them to visible objects."""
        distinct, count = self._configuration.distinct_assignment, len(belief.object_ids)
        used = np.argsort(-step.scores, kind="stable")[: count if distinct else None]
        visible = max(self._num_visible(belief), float(len(used)))
        assignments = gammaln(visible + 1.0) - gammaln(visible - len(used) + 1.0)
        if not distinct:
            assignments = len(used) * np.log(visible)
        return self._evenly([step.detections[i] for i in used], self._region) + float(assignments)

    def _num_visible(self, belief: HybridBelief) -> float:
        """Number of the map's objects that are visible from the pose of the heaviest hypothesis."""
        limits = self._configuration.visibility
        if limits.max_range_m <= 0.0 and limits.field_of_view_rad <= 0.0:
            return float(len(belief.object_ids))
        objects = np.array([planar_from_pose_vector(pose) for pose in belief.object_poses])
        robot = planar_from_pose_vector(belief.poses[0])
        relative = se2.between(broadcast_copy(robot, objects.shape), objects)[:, :2]
        return float(self._region.contains(relative, np.zeros((len(relative), 2, 2))).sum())

    def _evenly(self, detections: Sequence[PlanarDetection], region: SensorRegion) -> float:
        """Log density of detections uniform over the region's area, with class-independent scores.

        A range r has the density r / area; a bearing without range is uniform over the field of view.
        """
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
        """Log of n! P(n), the cardinality term of a set density, beside the density of each detection.

        P(n) is geometric, averaged over the sensor settings that evidence is to decide between; nothing was seen yet.
        """
        nothing = np.zeros((0, 3)), np.zeros(3), np.zeros((0, 2))
        births, _ = first_detections(region, self._rates, *nothing, 1.0)
        mean = self._rates.clutter_per_frame + births
        log_counts = count * np.log(mean) - (count + 1.0) * np.log1p(mean)
        return float(gammaln(count + 1.0) + np.logaddexp.reduce(log_counts) - np.log(len(mean)))


def _region(configuration: Configuration, *, is_open: bool) -> SensorRegion:
    """Sensor region of the null model: where an open world expects detections; in a closed one all that is visible.

    Where a closed world limits no range, the region ends at the largest depth of perception, if that is limited.
    """
    region, limits = sensor_region(configuration.open_world), configuration.visibility
    if is_open:
        return region
    return SensorRegion(
        min_range_m=0.0,
        max_range_m=limits.max_range_m or configuration.perception.max_depth_m or region.max_range_m,
        field_of_view_rad=limits.field_of_view_rad or 2.0 * np.pi,
    )


def _all_around(count: int) -> Viewpoints:
    """Viewpoints (count x azimuths) around each of ``count`` objects, at one metre and at the object's height."""
    azimuth = np.tile(np.linspace(-np.pi, np.pi, NUM_AZIMUTHS, endpoint=False), count)
    return Viewpoints(azimuth, np.zeros(len(azimuth)), np.ones(len(azimuth)))

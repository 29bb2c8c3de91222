"""Descriptor views of objects of unknown heading: modes over descriptor and heading, until one direction is left.

Given the positions of camera and object the views of one object are independent of everything else, so the modes hold
all their information, and their sum is the views' evidence for the association. In the plane, once a single direction
is left, all views enter the graph as factors. In space objects count as upright, the elevation of the camera is known
with the positions, views do not inform positions, and the yaw is reported.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.spatial.views import LEAST_COSINE
from semantic_slam.inference.semantics.camera_angles import camera_angles
from semantic_slam.inference.semantics.descriptors.heading_update import DirectionalView, updated_mixtures
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.heading_mixture import HeadingMixture
from semantic_slam.inference.states.object_views import DescriptorRecord, HeadingRecord, ObjectViews, coverage_of
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.view_coverage import ViewCoverage
from semantic_slam.latent.model import DescriptorBelief

STEP_RAD = np.pi / 72.0
"""Directions from an object to the camera are rounded to this, so that hypotheses share their work."""
ROUNDED_RAD = STEP_RAD / np.sqrt(12.0)
"""Standard deviation of what they are rounded by."""
SIGMA_STEP_RAD = STEP_RAD / 8.0
"""Standard deviations of directions are rounded up to a multiple of this."""
SETTLED_SHARE, SETTLED_RAD = 0.98, 0.15
"""Weight of the best direction, and its standard deviation, at which the heading counts as known."""


@dataclass(frozen=True, kw_only=True)
class UnorientedView:
    """One view of an object in one continuation."""

    row: int
    object_id: int
    number: int  # of the detection
    before: ObjectViews | None
    start: HeadingMixture  # before the view
    bearing_rad: float  # from the object to the camera, in map
    sigma_rad: float  # of the bearing
    elevation_rad: float | None = None  # of the camera over the object, in space; None: in the plane, with the box

    @cached_property
    def cell(self) -> tuple[int, int, int]:
        """Bearing, elevation and sigma in steps, so that hypotheses that agree share work, however it is divided."""
        return (
            round(self.bearing_rad / STEP_RAD),
            round((self.elevation_rad or 0.0) / STEP_RAD),
            ceil(np.hypot(self.sigma_rad, ROUNDED_RAD) / SIGMA_STEP_RAD),
        )

    @property
    def from_cell(self) -> DirectionalView:
        """The view as from the cell's centre."""
        bearing, elevation, sigma = self.cell
        return DirectionalView(
            modes=self.start,
            view=self.number,
            bearing_rad=STEP_RAD * bearing,
            sigma_rad=SIGMA_STEP_RAD * sigma,
            elevation_rad=None if self.elevation_rad is None else STEP_RAD * elevation,
        )


def update_unoriented(
    observation: LatentObservation,
    keyframe: int,
    detections: Sequence[Any],
    in_coverage: NDArray[np.bool_],
    views: Sequence[UnorientedView],
) -> list[tuple[ObjectViews, float]]:
    """The records after each view, and its log evidence; equal views are computed once."""
    keys = [(id(view.start), view.number, view.cell, view.object_id) for view in views]
    first = {key: at for at, key in reversed(list(enumerate(keys)))}
    different = list(first.values())
    sightings = [views[at].from_cell for at in different]
    found = updated_mixtures(observation, DetectionFeatures.of(detections), sightings)
    records = dict(
        zip(different, _records(observation, keyframe, detections, in_coverage, views, different, found), strict=True)
    )
    return [records[first[key]] for key in keys]


def _records(
    observation: LatentObservation,
    keyframe: int,
    detections: Sequence[Any],
    in_coverage: NDArray[np.bool_],
    views: Sequence[UnorientedView],
    rows: Sequence[int],
    found: Sequence[tuple[HeadingMixture, float]],
) -> list[tuple[ObjectViews, float]]:
    length = observation.num_dimensions
    means = np.concatenate([modes.mean[:, :length] for modes, _ in found] or [np.zeros((0, length))])
    variances = [np.einsum("mii->mi", modes.covariance)[:, :length] for modes, _ in found]
    belief = DescriptorBelief(means, np.sqrt(np.concatenate(variances or [np.zeros((0, length))])))
    by_mode = observation.model.class_log_likelihood(belief)
    ends = np.cumsum([len(modes.log_weight) for modes, _ in found])
    made = []
    for at, (modes, evidence), end in zip(rows, found, ends, strict=True):
        own = by_mode[end - len(modes.log_weight) : end]
        likelihood = np.logaddexp.reduce(modes.log_weight[:, None] + own, axis=0)
        view = views[at]
        recognised = bool(in_coverage[view.number])
        coverage = coverage_of(view.before).with_view(view.from_cell.bearing_rad, is_recognised=recognised)
        if view.elevation_rad is not None:
            made.append((_record_in_space(modes, likelihood, coverage), evidence))
            continue
        known = view.before.headings if view.before is not None else None
        fresh = (keyframe, detections[view.number])
        heading = HeadingRecord(modes, (*known.pending, fresh) if known else (fresh,))
        made.append((_record(heading, likelihood, coverage), evidence))
    return made


def _record_in_space(modes: HeadingMixture, likelihood: Array, coverage: ViewCoverage) -> ObjectViews:
    """Record of an object's views in space, where they do not enter the graph."""
    mean, variance = modes.descriptor()
    sigma = float(np.sqrt(modes.best()[1][-1, -1]))
    return ObjectViews(
        log_likelihood=likelihood,
        mutual_information=float("nan"),
        coverage=coverage,
        descriptor=DescriptorRecord(mean=mean, variance=variance, direction_sigma_rad=sigma, entering=()),
        headings=HeadingRecord(modes, ()),
        yaw=modes.yaw(),
    )


def _record(heading: HeadingRecord, likelihood: Array, coverage: ViewCoverage) -> ObjectViews:
    """Record of an object's views, which enter as factors as soon as its heading is known."""
    best, covariance, share = heading.modes.best()
    sigma = float(np.sqrt(covariance[-1, -1]))
    mean, variance = heading.modes.descriptor()
    entering: tuple[tuple[int, Any], ...] = ()
    if share >= SETTLED_SHARE and sigma <= SETTLED_RAD:
        entering, heading = heading.pending, HeadingRecord(heading.modes, ())
        mean, variance = best[:-1], np.diag(covariance)[:-1]
    return ObjectViews(
        log_likelihood=likelihood,
        mutual_information=float("nan"),
        coverage=coverage,
        descriptor=DescriptorRecord(
            mean=mean, variance=variance, direction_sigma_rad=sigma, entering=entering, heading_rad=float(best[-1])
        ),
        headings=heading,
    )


class DescriptorTables:
    """Evidence of views in an open world, where no map gives the headings of objects."""

    def __init__(self, observation: LatentObservation) -> None:
        self._observation = observation
        self._unseen: dict[tuple[float, ...], HeadingMixture] = {}

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the configured latent space, which the kind of class models must have."""
        assert models.latent is not None
        return cls(models.latent)

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Log evidence of the views of each candidate, and the objects' records after it."""
        rows = given.candidates.assignments
        detections = [given.step.detections[i] for i in given.used]
        turned = [view for number in range(len(detections)) for view in self._turned(given, number)]
        inside = given.step.in_coverage[given.used]
        found = update_unoriented(self._observation, given.step.index, detections, inside, turned)
        total, records = np.zeros(len(rows)), [dict[int, ObjectViews]() for _ in range(len(rows))]
        for view, (record, evidence) in zip(turned, found, strict=True):
            total[view.row] += evidence
            records[view.row][view.object_id] = record
        return SemanticEvidence.of(total, records)

    def _turned(self, given: SemanticInput, number: int) -> Iterator[UnorientedView]:
        """The views that one detection is of an object, candidate by candidate."""
        rows, detection = given.candidates.assignments, given.step.detections[given.used[number]]
        of_objects, spaces = np.flatnonzero(rows.objects[:, number] >= 0), given.parents[0].spaces
        robots, objects = rows.column("robot")[of_objects], rows.column("object_states")[of_objects, number]
        angles = camera_angles(spaces, robots, objects, detection.sensor)
        covariances = rows.column("robot_covariance")[of_objects]
        sigmas = np.sqrt(_azimuth_variances(spaces, robots, covariances, detection, angles[:, 1]))
        told = zip(of_objects.tolist(), angles.tolist(), sigmas.tolist(), strict=True)
        for row, (bearing, elevation), sigma in told:
            parent = given.parents[rows.parents[row]]
            object_id = int(given.object_ids[rows.objects[row, number]])
            before = parent.views.get(object_id)
            known = before.headings if before is not None else None
            yield UnorientedView(
                row=row,
                object_id=object_id,
                number=number,
                before=before,
                start=known.modes if known is not None else self._before(parent, object_id),
                bearing_rad=bearing,
                sigma_rad=sigma,
                elevation_rad=elevation if spaces.name == "spatial" else None,
            )

    def _before(self, component: Component, object_id: int) -> HeadingMixture:
        """The heading prior: by the map, or uniform."""
        prior = self._observation.prior_of(object_id)
        heading, variance = component.tracked_heading(object_id) or (0.0, 100.0)
        key = (float(heading), float(variance), *prior.mean[0].tolist())
        if key not in self._unseen:
            self._unseen[key] = HeadingMixture.about(prior, float(heading), float(np.sqrt(variance)))
        return self._unseen[key]


def _azimuth_variances(
    spaces: Spaces, robots: Array, covariances: Array, detection: Any, elevations_rad: Array
) -> Array:
    """(m,) [rad^2] of the camera's azimuth about an object, given where both are: the robot's heading and the ray."""
    if spaces.name != "spatial":
        return np.asarray(covariances[:, 2, 2] + detection.covariance[1, 1])
    yaws = se3.covariance_along_parent(robots, covariances)[:, -1, -1]
    return np.asarray(yaws + detection.ray_variance / np.maximum(np.cos(elevations_rad), LEAST_COSINE) ** 2)

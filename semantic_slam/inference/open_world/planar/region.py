"""The sensor's region (field of view and range limits), and occlusion."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import ndtr

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings
from semantic_slam.inference.models.planar.depth_ranges import WIDEST_RAD, covered, distance_per_depth, off_axis
from semantic_slam.inference.models.sensed_region import ANGLES, RANGES, SensedRegion
from semantic_slam.inference.open_world.margins import NOT_DETECTED, Margins

BOUNDS = (*RANGES, *ANGLES)
NO_SCAN = np.zeros((0, 2))
EXACT = np.zeros((1, 2))
LEAST_SIGMA = 1e-6
"""Least softness [m, rad] of the region's edges."""


@dataclass(frozen=True, kw_only=True)
class SensorRegion:
    """The region in which the sensor detects: an annular sector about a direction of the body, seen from its origin.

    Where ranges are depths along ``axis_rad``, the range limits are lines across that axis instead of arcs.
    """

    min_range_m: float
    max_range_m: float
    field_of_view_rad: float  # full angle
    direction_rad: float = 0.0  # bearing of the sector's middle in the body frame
    occluder_radius_m: float = 0.0  # radius of occluding objects; 0: no occlusion
    axis_rad: float | None = None  # bearing along which ranges are depths; None: they are distances
    is_known: bool = True  # else it is still to be learned, and nothing is taken to be in view

    @property
    def area_m2(self) -> float:
        right, left = self._covered
        return 0.5 * (left - right) * (self.max_range_m**2 - self.min_range_m**2)

    @property
    def farthest_m(self) -> float:
        """Distance beyond which nothing lies inside."""
        if not self.is_known:
            return 0.0
        if self.axis_rad is None:
            return self.max_range_m
        widest = abs(self._off_axis(self.axis_rad)) + 0.5 * self.field_of_view_rad
        return self.max_range_m / float(np.cos(min(widest, WIDEST_RAD)))

    def per_range(self, bearings_rad: Array) -> Array:
        """(...,) ratio of distance to range in a direction of the body frame; 1 unless ranges are depths."""
        if self.axis_rad is None:
            return np.ones(np.shape(bearings_rad))
        return distance_per_depth(wrap_angle(bearings_rad - self.axis_rad))

    def even_bearings(self, count: int) -> Array:
        """(count,) bearings in the body frame, each representing an equal area."""
        right, left = self._covered
        spread = right + (left - right) * (np.arange(count) + 0.5) / count
        return self.direction_rad + spread if self.axis_rad is None else self.axis_rad + off_axis(spread)

    @property
    def _covered(self) -> tuple[float, float]:
        """Twice the area at a range of 1 between an axis and its rightmost bearing, and its leftmost."""
        half = 0.5 * self.field_of_view_rad
        if self.axis_rad is None:
            return -half, half
        middle = self._off_axis(self.axis_rad)
        right, left = covered(np.array([middle - half, middle + half])).tolist()
        return right, left

    def _off_axis(self, axis_rad: float) -> float:
        """Bearing of the region's middle relative to an axis, in [-pi, pi)."""
        return float(wrap_angle(np.array(self.direction_rad - axis_rad)))

    def read_by(self, settings: NoiseSettings | None) -> Self:
        """The region under a hypothesis's noise settings, by which ranges are distances or depths."""
        if settings is None or not settings.ranges_are_depth:
            return self
        return replace(self, axis_rad=settings.axis_rad)

    def reaching(self, sensed: SensedRegion | None) -> Self:
        """The region with the bounds learned from detections; unchanged where they are not learned, or not yet."""
        return self if sensed is None else replace(self, **sensed.bounds(), is_known=True)

    def contains(self, relative: Array, covariance: Array) -> Array:
        """(...,) probability that objects at ``relative`` (..., 2) in the body frame, with (..., 2, 2), lie inside.

        Range and bearing count as independent normals: exact for a half-plane, close where the spread is small
        against the region.
        """
        return self.margins(relative, covariance).inside

    def margins(self, relative: Array, covariance: Array) -> Margins:
        """How far objects at ``relative`` (..., 2) in the body frame, with (..., 2, 2), are inside.

        Coordinates are range and bearing.
        """
        distance = np.maximum(np.hypot(relative[..., 0], relative[..., 1]), 1e-3)
        radial = relative / distance[..., None]
        across = np.stack([-radial[..., 1], radial[..., 0]], axis=-1)
        sigma_range = np.sqrt(np.einsum("...i,...ij,...j->...", radial, covariance, radial)) + LEAST_SIGMA
        sigma_across = np.sqrt(np.einsum("...i,...ij,...j->...", across, covariance, across)) + LEAST_SIGMA
        half, turn = 0.5 * self.field_of_view_rad, np.arctan2(relative[..., 1], relative[..., 0])
        slope = self.per_range(turn)
        nearest, farthest = self.min_range_m * slope, self.max_range_m * slope
        bearing, sigma = self.off_centre(turn), sigma_across / distance
        half = np.inf if half >= np.pi else half
        farthest = farthest if self.is_known else np.full_like(distance, -np.inf)
        return Margins(
            lower=np.stack([(nearest - distance) / sigma_range, (-half - bearing) / sigma]),
            upper=np.stack([(farthest - distance) / sigma_range, (half - bearing) / sigma]),
            slopes=np.stack([radial / sigma_range[..., None], across / sigma_across[..., None]]),
        )

    def off_centre(self, bearings_rad: Array) -> Array:
        """Angles between bearings in the body frame and the sector's middle, in [-pi, pi)."""
        return wrap_angle(bearings_rad - self.direction_rad)

    def holds(self, ranges_m: Array, bearings_rad: Array) -> Flags:
        """(...,) whether exact measurements lie inside; NaN ranges are taken to."""
        outside = (ranges_m < self.min_range_m) | (ranges_m > self.max_range_m)
        return np.asarray(~outside & (np.abs(self.off_centre(bearings_rad)) <= 0.5 * self.field_of_view_rad))

    def not_occluded(
        self,
        relative: Array,
        ranges_m: Array,
        bearings_rad: Array,
        free_range_scan: Array = NO_SCAN,
        variances: Array = EXACT,
        detected_as: Index = NOT_DETECTED,
    ) -> Array:
        """(...,) probability that nothing occludes (..., 2) positions in the body frame.

        Occluders are discs of the occluder's radius at the frame's own detections (D,), except those with NaN ranges,
        and surfaces of the ``free_range_scan`` (B, 2), bearing and range of the farthest surface in a depth image.
        ``variances`` (..., D or 1, 2): of how far each position is behind each detection [m^2], and of the angle
        between them [rad^2]. ``detected_as`` (...,): number of the detection of each position, which does not hide it;
        -1 for none.
        """
        if self.occluder_radius_m <= 0.0:
            return np.ones(relative.shape[:-1])
        unhidden = self._unhidden_by_objects(relative, ranges_m, bearings_rad, variances, detected_as)
        return unhidden * self._within(relative, free_range_scan)

    def _unhidden_by_objects(
        self, relative: Array, ranges_m: Array, bearings_rad: Array, variances: Array, detected_as: Index
    ) -> Array:
        """(...,) probability not to be occluded by detections; angle, distance and detections count as independent."""
        known = np.isfinite(ranges_m)
        if not known.any():
            return np.ones(relative.shape[:-1])
        ranges, bearings = ranges_m[known], bearings_rad[known]
        sigmas = np.sqrt(variances if variances.shape[-2] == 1 else variances[..., known, :]) + LEAST_SIGMA
        distance = np.hypot(relative[..., 0], relative[..., 1])[..., None]
        turn = np.abs(wrap_angle(np.arctan2(relative[..., 1], relative[..., 0])[..., None] - bearings))
        half = np.arcsin(np.minimum(self.occluder_radius_m / np.maximum(ranges, LEAST_SIGMA), 1.0))
        aside = ndtr((half - turn) / sigmas[..., 1]) - ndtr((-half - turn) / sigmas[..., 1])
        behind = ndtr((distance - ranges - 2.0 * self.occluder_radius_m) / sigmas[..., 0])
        others = detected_as[..., None] != np.flatnonzero(known)
        return np.asarray((1.0 - others * aside * behind).prod(axis=-1))

    def _within(self, relative: Array, free_range_scan: Array) -> Array:
        """(...,) 1 for positions nearer than the scanned surface, else 0; 1 outside the scan's bearings."""
        if len(free_range_scan) < 2:
            return np.ones(relative.shape[:-1])
        distance = np.hypot(relative[..., 0], relative[..., 1])
        aside = np.abs(wrap_angle(np.arctan2(relative[..., 1], relative[..., 0])[..., None] - free_range_scan[:, 0]))
        nearest = aside.argmin(axis=-1)
        apart = float(np.median(np.abs(np.diff(np.sort(free_range_scan[:, 0])))))
        behind = distance > free_range_scan[nearest, 1] + 2.0 * self.occluder_radius_m
        return np.asarray(1.0 - (behind & (aside.min(axis=-1) < apart)))


def sensor_region(settings: OpenWorldConfiguration) -> SensorRegion:
    """The sensor's region as configured, in which a missed detection counts; not known where it is to be learned."""
    return SensorRegion(
        min_range_m=settings.min_range_m,
        max_range_m=settings.max_range_m,
        field_of_view_rad=settings.field_of_view_rad,
        direction_rad=settings.direction_rad,
        occluder_radius_m=settings.occluder_radius_m,
        is_known=not settings.learn_region,
    )


def region_of(settings: OpenWorldConfiguration, learned: Mapping[str, float]) -> SensorRegion:
    """The region with bounds that a run has ``learned``, by their names in its beliefs; otherwise as configured.

    Not known where it was to be learned and the run has detected nothing.
    """
    told = {name: float(learned[f"open_world.{name}"]) for name in BOUNDS if f"open_world.{name}" in learned}
    return replace(sensor_region(settings), **told, is_known=bool(told) or not settings.learn_region)


def is_left_out(ranges_m: Array, bearings_rad: Array, settings: OpenWorldConfiguration) -> Flags:
    """(D,) which detections a run leaves out: outside the stated region, or beyond that which is learned."""
    if not settings.learn_region:
        return ~sensor_region(settings).holds(ranges_m, bearings_rad)
    return np.asarray(ranges_m > (settings.learn_region_within_m or np.inf))

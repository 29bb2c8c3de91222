"""The region in which a camera in space detects: in the image, and between two distances; and occlusion."""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from scipy.special import ndtr

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index, squared_norms
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.inference.open_world.margins import NOT_DETECTED, Margins
from semantic_slam.inference.open_world.rings import Rings
from semantic_slam.inference.open_world.spatial.free_ranges import seen_before_surfaces
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M

LEAST_SIGMA = 1e-6
"""Least softness [m, rad] of the region's edges."""
NUM_COLUMNS, NUM_ROWS = 6, 4
"""Rays over which the region is averaged."""


@dataclass(frozen=True, kw_only=True)
class SpatialRegion:
    """What projects into the image, between two distances; angles are off the optical axis, z.

    Horizontal angles are those of (x, z), vertical ones those of (y, z): the image's edges are planes through the
    optical centre.
    """

    min_range_m: float
    max_range_m: float
    half_width_rad: float  # to each side, below a quarter turn
    half_height_rad: float  # up and down
    middle_rad: tuple[float, float] = (0.0, 0.0)  # angles of the image's middle off the optical axis, right and down
    by_camera: bool = False  # the image's edges are those of a keyframe's camera, where they are known
    occluder_radius_m: float = 0.0  # radius of occluding balls; 0: no occlusion
    camera: Camera = field(default_factory=Camera)

    @classmethod
    def of(cls, settings: OpenWorldConfiguration) -> Self:
        """The configured region; until a keyframe gives the camera, it looks along the body's x."""
        return cls(
            min_range_m=settings.min_range_m,
            max_range_m=settings.max_range_m,
            half_width_rad=0.5 * settings.field_of_view_rad,
            half_height_rad=0.5 * settings.vertical_field_of_view_rad,
            occluder_radius_m=settings.occluder_radius_m,
            by_camera=settings.region_by_camera,
        )

    @cached_property
    def solid_angle(self) -> float:
        """[rad^2] of the image."""
        (left, right), (top, bottom) = np.sin(self.edges_rad)
        corners = np.arcsin([right * bottom, -left * bottom, -right * top, left * top])
        return float(corners.sum())

    @cached_property
    def edges_rad(self) -> Array:
        """(2, 2) angles of the image's edges off the optical axis: [left, right] and [top, bottom]."""
        halves = np.array([self.half_width_rad, self.half_height_rad])
        return np.asarray(np.array(self.middle_rad)[:, None] + halves[:, None] * [-1.0, 1.0])

    @property
    def volume_m3(self) -> float:
        return float(self.solid_angle * (self.max_range_m**3 - self.min_range_m**3) / 3.0)

    @property
    def farthest_m(self) -> float:
        """Distance from the body beyond which nothing lies inside."""
        return self.max_range_m + float(np.linalg.norm(self.camera.T_body_camera[:3]))

    def reaching(self, sensed: Camera | None) -> Self:
        """The region with the camera of a keyframe; None: as it is."""
        if sensed is None:
            return self
        if not self.by_camera or sensed.sight is None:
            return replace(self, camera=sensed)
        (right, down), (width, height) = sensed.sight.edges_rad.mean(axis=1), np.ptp(sensed.sight.edges_rad, axis=1)
        return replace(
            self,
            camera=sensed,
            middle_rad=(float(right), float(down)),
            half_width_rad=0.5 * float(width),
            half_height_rad=0.5 * float(height),
        )

    def read_by(self, settings: Any) -> Self:
        """The region itself: in space ranges are distances under all noise settings."""
        return self

    def contains(self, seen: Array, covariance: Array) -> Array:
        """(...,) probability that objects at ``seen`` (..., 3) in the optical frame, with (..., 3, 3), lie inside.

        Distance and both angles count as independent normals.
        """
        return self.margins(seen, covariance).inside

    def margins(self, seen: Array, covariance: Array) -> Margins:
        """How far objects at ``seen`` (..., 3) in the optical frame, with (..., 3, 3), are inside.

        Coordinates are distance, horizontal and vertical angle.
        """
        values, slopes = _coordinates(seen)
        sigmas = np.sqrt(np.einsum("...i,...ij,...j->...", slopes, covariance, slopes)) + LEAST_SIGMA
        ends = [[self.min_range_m, self.max_range_m], *self.edges_rad.tolist()]
        least, most = np.array(ends).T.reshape(2, len(ends), *[1] * (seen.ndim - 1))
        return Margins(
            lower=(least - values) / sigmas, upper=(most - values) / sigmas, slopes=slopes / sigmas[..., None]
        )

    def holds(self, seen: Array) -> Flags:
        """(...,) whether points (..., 3) of the optical frame lie inside."""
        squared = squared_norms(seen)
        inside = (squared > self.min_range_m**2) & (squared < self.max_range_m**2)
        return np.asarray(inside & self.shows(seen[..., 0], seen[..., 1], seen[..., 2]))

    def shows(self, right: Array, down: Array, ahead: Array) -> Flags:
        """(...,) whether points lie within the image's edges, whatever their distance."""
        if self.middle_rad != (0.0, 0.0):
            return _between(right, ahead, *self.edges_rad[0]) & _between(down, ahead, *self.edges_rad[1])
        aside = np.abs(right) * np.cos(self.half_width_rad) <= ahead * np.sin(self.half_width_rad)
        across = np.abs(down) * np.cos(self.half_height_rad) <= ahead * np.sin(self.half_height_rad)
        return np.asarray(aside & across)

    def not_occluded(
        self, seen: Array, covariance: Array, shown: Array, variances: Array, detected_as: Index = NOT_DETECTED
    ) -> Array:
        """(...,) probability that nothing occludes ``seen`` (..., 3), with (..., 3, 3), in the optical frame.

        Occluders are balls of the occluder's radius about a frame's detections ``shown`` (D, 3), with ``variances`` (D,
        2) of distance and direction. Distance and angle count as independent normals; the angle varies along the arc
        between both directions. ``detected_as`` (...,): which of ``shown`` is the detection of each point, which does
        not hide it; -1 for none.
        """
        if self.occluder_radius_m <= 0.0 or not len(shown):
            return np.ones(seen.shape[:-1])
        distance = np.maximum(np.sqrt(squared_norms(seen)), LEAST_DISTANCE_M)[..., None]
        unit, ranges = seen / distance, np.maximum(np.sqrt(squared_norms(shown)), LEAST_DISTANCE_M)
        along = np.einsum("...i,...ij,...j->...", unit, covariance, unit)[..., None]
        cosine = np.clip(unit @ (shown / ranges[:, None]).T, -1.0, 1.0)
        across = _towards(unit, shown / ranges[:, None], cosine, covariance) / distance**2
        turn = np.arccos(cosine)
        half = np.arcsin(np.minimum(self.occluder_radius_m / ranges, 1.0))
        sigma = np.sqrt(across + variances[:, 1]) + LEAST_SIGMA
        aside = ndtr((half - turn) / sigma) - ndtr((-half - turn) / sigma)
        apart = np.sqrt(along + variances[:, 0]) + LEAST_SIGMA
        behind = ndtr((distance - ranges - 2.0 * self.occluder_radius_m) / apart)
        others = detected_as[..., None] != np.arange(len(shown))
        return np.asarray((1.0 - others * aside * behind).prod(axis=-1))

    def seen_before_surfaces(self, seen: Array, covariance: Array) -> Array:
        """(...,) probability that no surface of the depth image hides ``seen`` (..., 3), with (..., 3, 3)."""
        sight = self.camera.sight
        if self.occluder_radius_m <= 0.0 or sight is None or not sight.sees_depth:
            return np.ones(seen.shape[:-1])
        return seen_before_surfaces(sight, seen, covariance, self.occluder_radius_m)

    def shells(self, count: int) -> Array:
        """(count,) middle distances of shells of equal volume."""
        centres = (np.arange(count) + 0.5) / count
        return np.cbrt(self.min_range_m**3 + centres * (self.max_range_m**3 - self.min_range_m**3))

    def all_over(self, shells: Rings) -> tuple[Array, Array]:
        """(P, 3) sample points of the region in the optical frame, and the shares (P,) of its volume they represent.

        Points of the same ray are consecutive, one in each shell.
        """
        return _all_over(tuple(self.edges_rad.ravel().tolist()), shells)


@lru_cache(maxsize=64)
def _all_over(edges_rad: tuple[float, ...], shells: Rings) -> tuple[Array, Array]:
    """:meth:`SpatialRegion.all_over` between the image's edges: left, right, top and bottom."""
    x, y = (
        low + (high - low) * (np.arange(count) + 0.5) / count
        for (low, high), count in zip(np.tan(edges_rad).reshape(2, 2), (NUM_COLUMNS, NUM_ROWS), strict=True)
    )
    right, down, reach = (grid.ravel() for grid in np.meshgrid(x, y, shells.ranges_m, indexing="ij"))
    rays = np.stack([right, down, np.ones(len(right))], axis=1)
    length = np.sqrt(squared_norms(rays))
    count = len(shells.shares)
    shares = length**-3 * np.tile(count * shells.shares, NUM_COLUMNS * NUM_ROWS)
    return rays * (reach / length)[:, None], shares / shares.sum()


def _coordinates(seen: Array) -> tuple[Array, Array]:
    """(3, ...) distance, and angles off the optical axis along both image axes, and (3, ..., 3) their Jacobians."""
    values, slopes = np.empty((3, *seen.shape[:-1])), np.zeros((3, *seen.shape))
    values[0] = np.maximum(np.sqrt(squared_norms(seen)), LEAST_DISTANCE_M)
    slopes[0] = seen / values[0, ..., None]
    aside, ahead = np.moveaxis(seen[..., :2], -1, 0), seen[..., 2]
    squared = np.maximum(aside * aside + ahead * ahead, LEAST_DISTANCE_M**2)
    values[1:] = np.arctan2(aside, ahead)
    slopes[1, ..., 0], slopes[2, ..., 1] = ahead / squared
    slopes[1:, ..., 2] = -aside / squared
    return values, slopes


def _between(aside: Array, ahead: Array, low: float, high: float) -> Flags:
    """(...,) whether angles off the optical axis, in front of the camera, lie between two below a quarter turn."""
    above = aside * np.cos(low) >= ahead * np.sin(low)
    return np.asarray(above & (aside * np.cos(high) <= ahead * np.sin(high)))


def _towards(unit: Array, others: Array, cosine: Array, covariance: Array) -> Array:
    """(..., D) variances [m^2] across directions ``unit`` (..., 3), each towards one of ``others`` (D, 3).

    ``cosine`` (..., D) are those of the angles between them. Towards itself a direction has the mean across it.
    """
    away = others - cosine[..., None] * unit[..., None, :]
    squared = squared_norms(away)
    apart = squared > LEAST_SIGMA**2
    along = np.vecdot(unit, (covariance @ unit[..., None])[..., 0])
    mean = 0.5 * (np.trace(covariance, axis1=-2, axis2=-1) - along)
    towards = np.vecdot(away @ covariance, away) / np.where(apart, squared, 1.0)
    return np.asarray(np.where(apart, towards, mean[..., None]))

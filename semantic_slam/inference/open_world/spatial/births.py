"""Births in space: the objects that detections start, and the expected number of first detections.

Intensities are per cubic metre: the evidence of a detection per metre and square radian under an intensity of one is
its squared range, the growth of a shell's volume. That of a ray alone, per square radian, is the volume along it from
one end of the region to the other.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy, squared_norms
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.observation import SpatialObservation
from semantic_slam.inference.open_world.births import WIDTH, Birth, LineOfSight
from semantic_slam.inference.open_world.existence import birth
from semantic_slam.inference.open_world.margins import NOT_DETECTED
from semantic_slam.inference.open_world.planar.detection_probability import share_after_looks
from semantic_slam.inference.open_world.planar.expected_births import HIDES, LEAST_IN_SIGHT
from semantic_slam.inference.open_world.rings import NUM_EVEN, Rings, rings
from semantic_slam.inference.open_world.spatial.looks import looks
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.state_space import StateSpace

AROUND = np.sqrt(3.0) * np.concatenate([np.eye(3), -np.eye(3)])
"""(6, 3) sigma points of equal weight, with the mean and covariance of a standard normal."""


class _Started(NamedTuple):
    """What n detections say of the positions in map of the objects that they start, given the robot."""

    gains: Array  # (n, 3, 6) Jacobians by the robot
    spreads: Array  # (n, 3, 3) covariances of the stand-in priors
    noises: Array  # (n, 3, 3) covariances given the detections
    log_areas: list[float]  # n
    log_stand_ins: list[float]  # n
    lines: Sequence[LineOfSight | None]  # n, None with a range


def births_in_space(
    landmark: StateSpace,
    model: SpatialObservation,
    detections: Sequence[SpatialDetection],
    robot: Array,
    region: SpatialRegion,
) -> list[Birth]:
    """The objects that ``detections`` start, seen from the predicted ``robot`` (7,)."""
    found = {}
    for has_range in {own.has_range for own in detections}:
        some = [own for own in detections if own.has_range == has_range]
        started = _at_ranges(some, robot) if has_range else _along_rays(some, robot, region)
        found[has_range] = iter(_births(landmark, model.object_priors(some, robot), started))
    return [next(found[own.has_range]) for own in detections]


def _births(landmark: StateSpace, priors: list[GaussianPrior], started: _Started) -> list[Birth]:
    """The births of n objects, whose attitudes, if they have any, are those of the priors: gravity holds them."""
    attitudes = np.array([prior.covariance for prior in priors])
    attitudes[:, landmark.position_rows, landmark.position_rows] = 0.0
    by_place = landmark.position_slopes(np.array([prior.mean for prior in priors]))
    to_object, nothing = np.swapaxes(by_place, 1, 2), np.zeros((attitudes.shape[1], 0))
    gains = to_object @ started.gains
    spreads, noises = (to_object @ own @ by_place + attitudes for own in (started.spreads, started.noises))
    return [
        Birth(
            prior=prior,
            gain=gains[number],
            spread=spreads[number],
            noise=noises[number],
            by_error=nothing,
            log_area=started.log_areas[number],
            log_stand_in=started.log_stand_ins[number],
            line=started.lines[number],
        )
        for number, prior in enumerate(priors)
    ]


def _at_ranges(detections: Sequence[SpatialDetection], robot: Array) -> _Started:
    """By detections with a range; the stand-in priors are :data:`WIDTH` times as wide as the measurements."""
    turn = so3.matrix(robot[3:])
    away = np.array([own.range_m * own.ray for own in detections])
    polar = turn @ np.array([np.column_stack([own.ray, own.range_m * own.basis]) for own in detections])
    noises = polar @ np.array([own.covariance for own in detections]) @ np.swapaxes(polar, 1, 2)
    return _Started(
        gains=np.concatenate([-turn @ so3.hat(away), broadcast_copy(turn, noises.shape)], axis=2),
        spreads=WIDTH**2 * noises,
        noises=noises,
        log_areas=[2.0 * float(np.log(own.range_m)) for own in detections],
        log_stand_ins=[float(own.log_normaliser - 1.5 * np.log1p(WIDTH**2)) for own in detections],
        lines=[None] * len(detections),
    )


def _along_rays(detections: Sequence[SpatialDetection], robot: Array, region: SpatialRegion) -> _Started:
    """By rays alone, at the range prior; the stand-in priors are wide across the rays only."""
    turn = so3.matrix(robot[3:])
    rays, bases = np.array([own.ray for own in detections]), np.array([own.basis for own in detections])
    ranges = np.array([own.log_range.range_m for own in detections])[:, None, None]
    sigmas = np.array([own.log_range.sigma for own in detections])[:, None, None]
    errors = np.array([own.covariance[1:, 1:] for own in detections])
    shown = ranges * rays[..., None]  # (n, 3, 1) from the camera
    along = turn @ shown
    by_range = sigmas**2 * (along @ np.swapaxes(along, 1, 2))
    aside = (ranges * turn) @ bases
    by_ray = aside @ errors @ np.swapaxes(aside, 1, 2)
    from_body = np.array([own.origin for own in detections]) + shown[..., 0]
    log_volume = float(np.log((region.max_range_m**3 - region.min_range_m**3) / 3.0))
    return _Started(
        gains=np.concatenate([-turn @ so3.hat(from_body), broadcast_copy(turn, by_ray.shape)], axis=2),
        spreads=by_range + WIDTH**2 * by_ray,
        noises=by_range + by_ray,
        log_areas=[log_volume] * len(detections),
        log_stand_ins=[float(own.log_normaliser - np.log1p(WIDTH**2)) for own in detections],
        lines=[
            LineOfSight(
                origin=robot[:3] + turn @ own.origin,
                direction=turn @ own.ray,
                variance=0.5 * float(np.trace(own.covariance[1:, 1:])),
                log_extent=log_volume,
            )
            for own in detections
        ],
    )


def expected_births_in_space(
    settings: OpenWorldConfiguration,
    component: Component,
    region: SpatialRegion,
    robot: Array,
    births: list[Birth],
    detections: Sequence[SpatialDetection],
    second: Array,
) -> tuple[Array, Array, Array]:
    """(G,) first detections expected from ``robot`` (7,), (D, G) log intensities [1/m^3] at detections, and existence.

    They are fewer where the camera has looked before, down to a least share. ``second`` (D, G) are the intensities of
    duplicate boxes of known objects.
    """
    rates, tracked = component.objects.rates, tracked_states(component)
    shells, along, which = _shells(region, rates)
    everywhere, shares = region.all_over(shells)
    at = region.camera.on(robot)
    born = _born_at(component.spaces.landmark, births, detections, robot, along.ranges_m)
    places = np.concatenate([at[:3] + so3.rotated(at[3:], everywhere), born])
    fall_off = rates.fall_off(np.sqrt(squared_norms(born - at[:3]))).reshape(len(births), len(AROUND), len(rates))
    fall_off[_are_rays(detections)] = len(AROUND) * along.shares[:, None] * along.fall_off[:, which]
    count = len(shares)
    at_detections = rates.birth_density * rates.probability * fall_off.reshape(-1, len(rates))
    found = np.concatenate([_first_detections_at(shells, which, count, rates), at_detections])
    if settings.least_undetected_share < 1.0 and len(tracked.trail):
        hiding = component.spaces.landmark.position(tracked.states[component.objects.existence > HIDES])
        left = undetected_share_in_space(region, rates, tracked.trail, places, hiding)
        found = found * np.maximum(left, settings.least_undetected_share)
    shown = region.seen_before_surfaces(everywhere, np.zeros((count, 3, 3)))
    expected = region.volume_m3 * ((shares * shown) @ found[:count])
    at_births = found[count:].reshape(len(births), len(AROUND), len(rates)).mean(axis=1)
    at_births *= _in_sight(region, detections)[:, None]
    intensity, existence = birth(at_births, rates.clutter_per_frame / region.volume_m3 + second)
    return expected, np.log(intensity), existence


def first_detections_in_space(region: SpatialRegion, rates: DetectionRates) -> Array:
    """(G,) first detections expected in the region where nothing was seen yet."""
    shells, _, which = _shells(region, rates)
    shares = region.all_over(shells)[1]
    return region.volume_m3 * (shares @ _first_detections_at(shells, which, len(shares), rates))


def undetected_share_in_space(
    region: SpatialRegion, rates: DetectionRates, trail: Array, points: Array, hiding: Array
) -> Array:
    """(D, G) factor on first detections at ``points`` (D, 3) in map, by earlier looks from ``trail`` (T, 7).

    These are the robot's poses so far, from which nothing was detected there. What is occluded by the objects
    ``hiding`` (N, 3) was not looked at.
    """
    numbers, times, ranges = looks(region, trail, points, hiding)
    shares = rates.sensors[0].fall_off(ranges)
    return share_after_looks(rates, numbers, times, shares, (len(points), len(trail)))


def shown_by(region: SpatialRegion, detections: Sequence[SpatialDetection]) -> tuple[Array, Array]:
    """(n, 3) detections in the optical frame, and (n, 2) variances of their distances [m^2] and directions [rad^2].

    These are the detections with a range: what a ray alone occludes is unknown.
    """
    ranged = [own for own in detections if own.has_range]
    if not ranged:
        return np.zeros((0, 3)), np.zeros((0, 2))
    points = np.array([own.range_m * own.ray for own in ranged])
    variances = [(own.covariance[0, 0], 0.5 * np.trace(own.covariance[1:, 1:])) for own in ranged]
    return region.camera.seen(points), np.array(variances)


def among_shown(detections: Sequence[SpatialDetection]) -> Index:
    """(D,) numbers of detections among those of :func:`shown_by`; -1 for a ray alone."""
    are_rays = _are_rays(detections)
    return np.where(are_rays, NOT_DETECTED, np.cumsum(~are_rays) - 1)


def _in_sight(region: SpatialRegion, detections: Sequence[SpatialDetection]) -> Array:
    """(D,) probability that no other detection occludes a detection, or at least a small share; 1 for a ray alone."""
    shown, variances = shown_by(region, detections)
    nothing = np.zeros((len(shown), 3, 3))
    doubled = 2.0 * variances  # of both
    in_sight = np.ones(len(detections))
    if len(shown):
        seen = region.not_occluded(shown, nothing, shown, doubled, detected_as=np.arange(len(shown)))
        in_sight[~_are_rays(detections)] = np.maximum(seen, LEAST_IN_SIGHT)
    return in_sight


def _first_detections_at(shells: Rings, which: Index, count: int, rates: DetectionRates) -> Array:
    """(P, G) first detections per cubic metre at the P = ``count`` sample points of the region."""
    every = np.tile(shells.fall_off[:, which], (count // len(shells.shares), 1))
    return np.asarray(rates.birth_density * rates.probability * every)


def _shells(region: SpatialRegion, rates: DetectionRates) -> tuple[Rings, Rings, Index]:
    """Shells of the region, then those along a ray, as many as :data:`AROUND`; (G,) which half range a setting has."""
    half_ranges, which = np.unique(rates.half_range_m, return_inverse=True)
    bounds = region.min_range_m, region.max_range_m, tuple(half_ranges.tolist()), 3
    everywhere, along = (rings(*bounds, even=count, falling=count) for count in (NUM_EVEN, len(AROUND)))
    return everywhere, along, which


def _are_rays(detections: Sequence[SpatialDetection]) -> Flags:
    """(D,) which detections have no range."""
    return np.array([not own.has_range for own in detections], dtype=bool)


def _born_at(
    landmark: StateSpace, births: list[Birth], detections: Sequence[SpatialDetection], robot: Array, ranges_m: Array
) -> Array:
    """(6 D, 3) sample points in map of where the objects of detections may be, given the robot.

    For a ray alone they are at ``ranges_m`` (6,) along it.
    """
    places = np.empty((len(births), len(AROUND), 3))
    is_ray = _are_rays(detections)
    alone = [own for own in detections if not own.has_range]
    origins, rays = (np.array(own).reshape(-1, 1, 3) for own in ([d.origin for d in alone], [d.ray for d in alone]))
    reached = origins + ranges_m[:, None] * rays
    places[is_ray] = robot[:3] + so3.rotated(robot[3:], reached)
    for number in np.flatnonzero(~is_ray).tolist():
        own = births[number]
        slopes = landmark.position_slopes(own.prior.mean)
        root = np.linalg.cholesky(slopes @ own.noise @ slopes.T)
        places[number] = landmark.position(own.prior.mean) + AROUND @ root.T
    return places.reshape(-1, 3)

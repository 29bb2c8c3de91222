"""Detection probability of each object of one hypothesis, for a robot at each of K modes (planar poses)."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.open_world.margins import NOT_DETECTED, Places, with_occlusion
from semantic_slam.inference.open_world.planar.region import NO_SCAN, SensorRegion
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.seen_again import SeenAgain
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.in_view import InViewProbabilities, PredictedDetections
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M

MOST_LOOKS = 50
"""Number of newest looks at one place that count: by then next to nothing is left to be found there."""

NOTHING = np.zeros((0, 2))
"""No object positions."""


class Occluders(NamedTuple):
    """What a frame itself shows of occlusion, in the body frame."""

    ranges_m: Array  # (D,) of its detections, NaN without depth
    bearings_rad: Array  # (D,)
    variances: Array  # (D, 2) of these [m^2, rad^2]
    free_range_scan: Array = NO_SCAN  # (B, 2) bearing and range of the farthest surface in each direction

    @classmethod
    def of(cls, detections: Sequence[Any], free_range_scan: Array = NO_SCAN) -> "Occluders":
        """Occluders by a frame's planar ``detections``; a bearing alone occludes nothing."""
        covariances = np.array([detection.covariance for detection in detections]).reshape(-1, 2, 2)
        return cls(
            ranges_m=np.array([detection.range_m for detection in detections], dtype=np.float64),
            bearings_rad=np.array([detection.bearing_rad for detection in detections], dtype=np.float64),
            variances=np.nan_to_num(np.diagonal(covariances, axis1=1, axis2=2)),
            free_range_scan=free_range_scan,
        )

    @property
    def bearing_variance(self) -> float:
        """Mean variance of the bearings [rad^2] of what occludes; 0 without any."""
        known = np.isfinite(self.ranges_m)
        return float(self.variances[known, 1].mean()) if known.any() else 0.0


NOTHING_SHOWN = Occluders(np.zeros(0), np.zeros(0), np.zeros((0, 2)))
"""No occluders."""


def polar_variances(relative: Array, covariance: Array) -> Array:
    """(..., 2) of range [m^2] and bearing [rad^2] of positions (..., 2) with covariances (..., 2, 2)."""
    distance = np.maximum(np.hypot(relative[..., 0], relative[..., 1]), LEAST_DISTANCE_M)[..., None]
    radial = relative / distance
    across = np.stack([-radial[..., 1], radial[..., 0]], axis=-1) / distance
    axes = np.stack([radial, across], axis=-2)
    return np.asarray(np.einsum("...ai,...ij,...aj->...a", axes, covariance, axes))


def detection_probabilities(
    region: SensorRegion,
    rates: DetectionRates,
    prediction: PredictedObjects,
    robot: Array,
    covariance: Array,
    shown: Occluders,
    seen: SeenAgain,
) -> tuple[PredictedDetections, Array]:
    """Predicted detections of existing objects from modes ``robot`` (K, 3), and (n, G) how probably those ``seen`` are.

    Objects may be occluded by what is ``shown``.
    """
    shift = se2.log(se2.between(prediction.robot, robot))  # (K, 3)
    moved = np.einsum("nij,kj->kni", prediction.gain, shift)
    objects = se2.compose(prediction.objects, se2.exp(moved))  # (K, N, 3)
    places = _places(se2.between(robot[:, None], objects), prediction, covariance)
    in_view, chance = partial(_overlap, region, shown), partial(_chance, region, rates)
    return seen.predicted(places, prediction.in_view, rates.runs, in_view, chance)


def predicted_detection_probabilities(
    region: SensorRegion, rates: DetectionRates, prediction: PredictedObjects
) -> PredictedDetections:
    """Predicted detections of existing objects from the predicted robot (K = 1), without occlusion."""
    relative = se2.between(prediction.robot, prediction.objects)[None]
    places = _places(relative, prediction, prediction.robot_covariance[None])
    overlap, unoccluded = _overlap(region, NOTHING_SHOWN, places, prediction.in_view.unoccluded, NOT_DETECTED)
    return prediction.in_view.predicted(overlap, unoccluded, _chance(region, rates, places.points), rates.runs)


def _chance(region: SensorRegion, rates: DetectionRates, points: Array) -> Array:
    """(..., G) detection probabilities of objects in view, by their expected places (..., 2) in the body frame."""
    chance = rates.probability * rates.fall_off(np.hypot(points[..., 0], points[..., 1]))
    return rates.by_direction.times(chance, points, region.direction_rad)


def _overlap(
    region: SensorRegion, shown: Occluders, places: Places, before: Array, detected_as: Index
) -> tuple[InViewProbabilities, Array]:
    """Probabilities (...,) to be in view for objects that nothing occluded ``before``, and that nothing does now.

    ``detected_as`` (...,): numbers of their own detections, which do not hide them; -1 for none.
    """
    overlap, lasting = places.overlap(region.margins)
    unoccluded = np.ones(overlap.now.shape)
    if region.occluder_radius_m > 0.0:
        own = polar_variances(places.points, places.covariance)
        variances = own[..., None, :] + shown.variances
        ranges, bearings = shown.ranges_m, shown.bearings_rad
        unoccluded = region.not_occluded(places.points, ranges, bearings, shown.free_range_scan, variances, detected_as)
        lasts = lasting[1] * places.lasting_sight(own[..., 1], shown.bearing_variance)
        overlap = with_occlusion(overlap, before, unoccluded, lasts)
    return overlap, unoccluded


def _places(relative: Array, prediction: PredictedObjects, covariance: Array) -> Places:
    """Positions in the body frame with (K, N, 2, 2) covariances, to first order.

    With p = R_x^T (t_o - t_x): dp/dx = [-I, -S p] and dp/do = [R_x^T R_o, 0], S a quarter turn.
    """
    by_robot = np.zeros((*relative.shape[:-1], 2, 3))
    by_robot[..., 0, 0] = by_robot[..., 1, 1] = -1.0
    by_robot[..., 0, 2], by_robot[..., 1, 2] = relative[..., 1], -relative[..., 0]
    by_object = np.zeros_like(by_robot)
    cos, sin = np.cos(relative[..., 2]), np.sin(relative[..., 2])
    by_object[..., 0, 0], by_object[..., 0, 1], by_object[..., 1, 0], by_object[..., 1, 1] = cos, -sin, sin, cos
    together = by_robot + by_object @ prediction.gain
    by_remainder = by_object @ prediction.remainder @ np.swapaxes(by_object, -1, -2)
    spread = together @ covariance[:, None] @ np.swapaxes(together, -1, -2)
    turned = prediction.robot_before[2]
    return Places(
        points=relative[..., :2],
        covariance=spread + by_remainder,
        by_robot=spread,
        by_motion=by_robot @ prediction.motion_noise @ np.swapaxes(by_robot, -1, -2),
        turn=np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]),
        shift=prediction.robot_before[:2],
    )


def undetected_share(
    region: SensorRegion, rates: DetectionRates, trail: Array, points: Array, hiding: Array = NOTHING
) -> Array:
    """(D, G) factor on first detections at ``points`` (D, 2) in map, by earlier looks from ``trail`` (T, 3).

    These are the robot's poses so far, from which nothing was detected there. Positions count as exact. What is
    occluded by the objects ``hiding`` (N, 2) was not looked at.
    """
    numbers, times, ranges = looks(region, trail, points, hiding)
    shares = _shares(region, rates.sensors[0], points[numbers], trail[times], ranges)
    return share_after_looks(rates, numbers, times, shares, (len(points), len(trail)))


def share_after_looks(
    rates: DetectionRates, numbers: Index, times: Index, shares: Array, counts: tuple[int, int]
) -> Array:
    """(D, G) factor on first detections after L looks without one, sorted by points ``numbers`` (L,), then ``times``.

    ``shares`` (L, P) are the detection probabilities under each sensor of the rates, relative to those right at the
    sensor; ``counts``: numbers of points and of keyframes.
    """
    (num_points, num_times), (sensors, which) = counts, rates.sensors
    ends = np.cumsum(np.bincount(numbers, minlength=num_points))
    columns = np.arange(len(numbers)) - ends[numbers]  # -1: the newest look of its point
    newest = columns >= -MOST_LOOKS
    count = int(-columns[newest].min(initial=0))
    if not count:
        return np.ones((num_points, len(rates)))
    until = np.append(times[1:], 0)
    until[columns == -1] = num_times
    chances, gaps = np.zeros((count, num_points, len(sensors))), np.zeros((count, num_points), dtype=int)
    chances[columns[newest], numbers[newest]] = shares[newest]
    gaps[columns[newest], numbers[newest]] = (until - times)[newest]
    return sensors.runs.still_undetected(chances, gaps)[:, which]


def _shares(region: SensorRegion, sensors: DetectionRates, points: Array, robots: Array, ranges: Array) -> Array:
    """(L, P) detection probabilities of (L, 2) points from (L, 3) poses, as shares of those right at the sensor."""
    relative, direction_rad = points - robots[:, :2], region.direction_rad + robots[:, 2]
    return sensors.by_direction.times(sensors.fall_off(ranges), relative, direction_rad)


def looks(region: SensorRegion, trail: Array, points: Array, hiding: Array) -> tuple[Index, Index, Array]:
    """(L,) which of (D, 2) points are in the region from poses ``trail`` (T, 3), from which pose, and the range [m].

    Sorted by points, then by poses; without occluded ones.
    """
    x, y = (points[:, None, axis] - trail[:, axis] for axis in (0, 1))
    squared = x * x + y * y
    numbers, times = np.nonzero((squared > region.min_range_m**2) & (squared < region.farthest_m**2))
    bearing = np.arctan2(y[numbers, times], x[numbers, times]) - trail[times, 2]
    inside = np.abs(region.off_centre(bearing)) <= 0.5 * region.field_of_view_rad
    if region.axis_rad is not None:
        range_m = np.sqrt(squared[numbers, times]) / region.per_range(bearing)
        inside &= (range_m > region.min_range_m) & (range_m < region.max_range_m)
    numbers, times = numbers[inside], times[inside]
    if region.occluder_radius_m > 0.0 and len(hiding) and len(numbers):
        near = np.hypot(*(hiding[:, None] - points).T).min(axis=0) < region.farthest_m
        free = ~_hidden(region, points[numbers] - trail[times, :2], hiding[near] - trail[times, None, :2])
        numbers, times = numbers[free], times[free]
    return numbers, times, np.sqrt(squared[numbers, times])


def _hidden(region: SensorRegion, point: Array, hiding: Array) -> Flags:
    """(Q,) whether one of N objects (Q, N, 2) occludes a point (Q, 2), both relative to the robot."""
    x, y = point[:, None, 0], point[:, None, 1]
    distance, reach = np.hypot(x, y), np.hypot(hiding[..., 0], hiding[..., 1])
    aside = np.abs(x * hiding[..., 1] - y * hiding[..., 0]) < region.occluder_radius_m * distance
    behind = (x * hiding[..., 0] + y * hiding[..., 1] > 0.0) & (distance > reach + 2.0 * region.occluder_radius_m)
    return np.asarray((aside & behind).any(axis=1))

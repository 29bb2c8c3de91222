"""Detection probability of each object of one hypothesis, for a robot at each of K modes (planar poses)."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.open_world.planar.region import NO_SCAN, SensorRegion
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M

LEAST_DETECTION_SHARE = 0.02
"""Least share of the detection probability for detected objects that seem to lie outside the region."""

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

    def variances_before(self, relative: Array, covariance: Array) -> Array:
        """(..., D, 2) variances of distance and angle between detections and positions (..., 2) with (..., 2, 2)."""
        own = polar_variances(relative, covariance)
        return np.asarray(own[..., None, :] + self.variances)


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
) -> Array:
    """(K, N, G) detection probabilities of existing objects from modes ``robot`` (K, 3) with (K, 3, 3).

    Objects may be occluded by what is ``shown``.
    """
    shift = se2.log(se2.between(prediction.robot, robot))  # (K, 3)
    moved = np.einsum("nij,kj->kni", prediction.gain, shift)
    objects = se2.compose(prediction.objects, se2.exp(moved))  # (K, N, 3)
    relative = se2.between(robot[:, None], objects)
    spread = _relative_covariance(relative, prediction, covariance)
    inside = region.contains(relative[..., :2], spread)
    if region.occluder_radius_m > 0.0:
        variances = shown.variances_before(relative[..., :2], spread)
        inside *= region.not_occluded(
            relative[..., :2], shown.ranges_m, shown.bearings_rad, shown.free_range_scan, variances
        )
    return _by_rates(region, rates, inside, relative)


def predicted_detection_probabilities(
    region: SensorRegion, rates: DetectionRates, prediction: PredictedObjects
) -> Array:
    """(N, G) detection probabilities of existing objects at the prediction, without occlusion."""
    relative = se2.between(prediction.robot, prediction.objects)[None]
    spread = _relative_covariance(relative, prediction, prediction.robot_covariance[None])
    return _by_rates(region, rates, region.contains(relative[..., :2], spread)[0], relative[0])


def _by_rates(region: SensorRegion, rates: DetectionRates, inside: Array, relative: Array) -> Array:
    """(..., G) detection probabilities of objects at (..., 3) in the body frame, each inside with probability (...,).

    They fall off with the expected distance and depend on the expected direction.
    """
    distance = np.hypot(relative[..., 0], relative[..., 1])
    found = inside[..., None] * rates.probability * rates.fall_off(distance)
    return rates.by_direction.times(found, relative, region.direction_rad)


def _relative_covariance(relative: Array, prediction: PredictedObjects, covariance: Array) -> Array:
    """(K, N, 2, 2) of the objects' positions in the body frame, to first order.

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
    return np.asarray(together @ covariance[:, None] @ np.swapaxes(together, -1, -2) + by_remainder)


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

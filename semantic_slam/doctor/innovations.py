"""Innovations between consecutive keyframes: distances of detections after odometry, with their covariances.

Needs neither a map nor hypotheses. Association is by mutual nearest neighbours. Many pairs may be of different objects,
so only the nearest quarter of all pairs is used.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.perception.measurement import SemanticMeasurements

QUANTILE = 0.25
EXPECTED = -2.0 * np.log(1.0 - QUANTILE)
"""That quantile of chi-squared with two degrees of freedom."""
LEAST_PAIRS = 60
"""Fewer tell nothing: with 51 a healthy drive seemed to have clocks half a second apart."""
MOST_KEYFRAMES = 400
AS_IT_IS = np.eye(2)


@dataclass(frozen=True)
class Points:
    """Planar positions of P detections in the body frame."""

    xy: Array  # (P, 2)
    covariances: Array  # (P, 2, 2)

    def turned(self, matrix: Array) -> "Points":
        """By a rotation, or a reflection, of the plane."""
        return Points(self.xy @ matrix.T, matrix @ self.covariances @ matrix.T)


@dataclass(frozen=True)
class Innovations:
    """The K keyframes of a drive whose detections have positions."""

    stamps_s: Array  # (K,)
    points: Sequence[Points]
    controls: Array  # (K, 3) planar motion since the keyframe before
    motion_covariances: Array  # (K, 3, 3) of it
    odometry: Array  # (N, 4) time [s], x, y, yaw in odom

    @classmethod
    def of(cls, keyframes: Sequence[Keyframe], odometry: Array, configuration: Configuration) -> "Innovations":
        noise = ConfiguredNoise(configuration.odometry, configuration.perception)
        keyframes = keyframes[:MOST_KEYFRAMES]
        controls = np.array([planar_from_pose_vector(each.odometry) for each in keyframes]).reshape(-1, 3)
        told = [planar_from_covariance(each.odometry_covariance) for each in keyframes]
        return cls(
            np.array([each.stamp_ns / NANOSECONDS for each in keyframes]),
            [_points(each.measurements, noise) for each in keyframes],
            controls,
            np.array([noise.of_motion(*pair) for pair in zip(controls, told, strict=True)]).reshape(-1, 3, 3),
            odometry,
        )

    def excess(self, *, turn: Array = AS_IT_IS) -> float:
        """By which factor the nearest quarter of all pairs lies farther apart than stated; NaN with too few pairs.

        ``turn``: if the places of the detections were turned so.
        """
        points = self.points if turn is AS_IT_IS else [each.turned(turn) for each in self.points]
        return _excess(self._squares(points, self.controls, range(1, len(points))))

    def ratio_if_later(self, later_s: float) -> float:
        """How far pairs lie apart if the odometry of so much later were that of the detections, over how far they do.

        Of the keyframes at which there is odometry then, too; NaN where these are less than half of all.
        """
        if not len(self.odometry):
            return float("nan")
        at, times = self.stamps_s + later_s, self.odometry[:, 0]
        is_told = (at >= times.min()) & (at <= times.max())
        rows = np.flatnonzero(is_told[1:] & is_told[:-1]) + 1
        if 2 * len(rows) < len(self.points) - 1:
            return float("nan")
        ours = _excess(self._squares(self.points, self.controls, rows))
        return _excess(self._squares(self.points, self._controls(at), rows)) / ours if ours > 0.0 else float("nan")

    def _squares(self, points: Sequence[Points], controls: Array, rows: Iterable[int]) -> Array:
        """(N,) squared distances of pairs, in standard deviations; chi-squared with two degrees if all is as stated."""
        found = [np.zeros(0)]
        for k in rows:
            if len(points[k - 1].xy) and len(points[k].xy):
                moved = _moved(points[k - 1], controls[k], self.motion_covariances[k])
                found.append(_pair_squares(moved, points[k]))
        return np.concatenate(found)

    def _controls(self, at: Array) -> Array:
        """(K, 3) motions between the keyframes as odometry tells them of other times [s]."""
        times, x, y, yaw = self.odometry.T
        poses = np.stack([np.interp(at, times, values) for values in (x, y, np.unwrap(yaw))], axis=-1)
        return np.asarray(se2.between(poses[np.maximum(np.arange(len(poses)) - 1, 0)], poses))


def _excess(squares: Array) -> float:
    if len(squares) < LEAST_PAIRS:
        return float("nan")
    return float(np.sqrt(np.quantile(squares, QUANTILE) / EXPECTED))


def _points(measurements: SemanticMeasurements, noise: ConfiguredNoise) -> Points:
    """Places of the detections that have a range."""
    known = np.flatnonzero(np.isfinite(measurements.ranges_m))
    r, b = measurements.ranges_m[known], measurements.bearings_rad[known]
    polar = noise.of_detections(r, measurements.geometric_covariances[known])
    c, s = np.cos(b), np.sin(b)
    slopes = np.stack([np.stack([c, -r * s], axis=-1), np.stack([s, r * c], axis=-1)], axis=-2)  # of x, y by r, b
    return Points(np.stack([r * c, r * s], axis=-1), slopes @ polar @ slopes.swapaxes(1, 2))


def _moved(points: Points, control: Array, motion_covariance: Array) -> Points:
    """The points as the body sees them after a motion, about whose end it errs."""
    back = se2.inverse(control)
    c, s = np.cos(back[2]), np.sin(back[2])
    rotation = np.array([[c, -s], [s, c]])
    xy = points.xy @ rotation.T + back[:2]
    slopes = np.zeros((len(xy), 2, 3))  # of x, y by an error of the motion's end
    slopes[:, 0, 0] = slopes[:, 1, 1] = -1.0
    slopes[:, 0, 2], slopes[:, 1, 2] = xy[:, 1], -xy[:, 0]
    covariances = rotation @ points.covariances @ rotation.T + slopes @ motion_covariance @ slopes.swapaxes(1, 2)
    return Points(xy, covariances)


def _pair_squares(expected: Points, seen: Points) -> Array:
    """(N,) of the pairs of points that are each other's nearest."""
    distances = np.linalg.norm(expected.xy[:, None] - seen.xy[None], axis=-1)
    nearest, back = distances.argmin(axis=1), distances.argmin(axis=0)
    rows = np.flatnonzero(back[nearest] == np.arange(len(nearest)))
    pairs = rows, nearest[rows]
    gaps = expected.xy[pairs[0]] - seen.xy[pairs[1]]
    covariances = expected.covariances[pairs[0]] + seen.covariances[pairs[1]]
    return np.asarray((gaps * np.linalg.solve(covariances, gaps[..., None])[..., 0]).sum(axis=-1))

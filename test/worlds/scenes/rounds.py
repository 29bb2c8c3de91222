"""A camera that flies round after round in a room and sees points on the walls: with depth, or by rays alone."""

import numpy as np

from semantic_slam import Detection, Keyframe
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array

ROUND = 12
"""Keyframes of a round."""
DRIFT = np.array([0.003, 0.003, 0.005, 0.01, 0.01, 0.01])
"""Standard deviations of odometry, [rotation, translation]."""
RANGE_SIGMA, RAY_SIGMA, UP_SIGMA_RAD = 0.05, 0.01, 0.02
RADIUS_M, HALF_VIEW_RAD = 1.0, 0.7
T_BODY_CAMERA = np.array([0.1, -0.05, 0.02, -0.5, 0.5, -0.5, 0.5])
START_SIGMAS = np.full(6, 0.01)


class Rounds:
    """Keyframes of the flight, drawn one after another from a seed."""

    def __init__(self, seed: int, num_points: int, *, has_depth: bool, are_named: bool) -> None:
        self._random = np.random.default_rng(seed)
        around = np.linspace(0.0, 2.0 * np.pi, num_points, endpoint=False)
        away = self._random.uniform(2.0, 3.0, num_points)
        heights = self._random.uniform(-0.6, 0.6, num_points)
        self.points = np.column_stack([away * np.cos(around), away * np.sin(around), heights])
        self._has_depth, self._are_named = has_depth, are_named

    @staticmethod
    def pose(index: int) -> Array:
        """(7,) the true pose: on a circle, looking outwards and a little ahead, rising and leaning as it goes."""
        angle = 2.0 * np.pi * (index % ROUND) / ROUND
        place = np.array([RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle), 0.2 * np.sin(2.0 * angle)])
        lean = so3.exp(np.array([0.1 * np.sin(3.0 * angle), 0.1 * np.cos(2.0 * angle), 0.0]))
        return np.append(place, so3.product(so3.exp(np.array([0.0, 0.0, angle + 0.5])), lean))

    def keyframes(self, count: int) -> list[Keyframe]:
        """The first keyframes, with gravity in every third one."""
        return [self._keyframe(index) for index in range(count)]

    def _keyframe(self, index: int) -> Keyframe:
        x, draw = self.pose(index), self._random.normal
        motion = se3.between(self.pose(index - 1), x) if index else np.append(np.zeros(6), 1.0)
        if index:
            motion = se3.retract(motion, DRIFT * draw(size=6))
        up = so3.matrix(x[3:])[2] + UP_SIGMA_RAD * draw(size=3)
        return Keyframe.spatial(
            index,
            motion=motion,
            motion_covariance=np.diag(DRIFT[se3.TO_MESSAGE] ** 2),
            detections=self._detections(x),
            T_body_camera=T_BODY_CAMERA,
            **({} if index % 3 or self._are_named else {"up": up, "sigma_up_rad": UP_SIGMA_RAD}),
        )

    def _detections(self, x: Array) -> list[Detection]:
        camera = se3.compose(x, T_BODY_CAMERA)
        away = so3.rotated(so3.inverse(camera[3:]), self.points - camera[:3])
        distance = np.linalg.norm(away, axis=1)
        return [
            self._detection(away[n] / distance[n], float(distance[n]), n)
            for n in np.flatnonzero(away[:, 2] > np.cos(HALF_VIEW_RAD) * distance)
        ]

    def _detection(self, ray: Array, range_m: float, number: int) -> Detection:
        noise, off_m = RAY_SIGMA * self._random.normal(size=3), RANGE_SIGMA * self._random.normal()
        ranged = {"range_m": range_m + off_m, "sigma_range_m": RANGE_SIGMA} if self._has_depth else {}
        return Detection.along(
            ray + noise,
            ray_covariance=RAY_SIGMA**2 * np.eye(3),
            T_body_sensor=T_BODY_CAMERA,
            track_id=f"p{number}" if self._are_named else "",
            **ranged,
        )

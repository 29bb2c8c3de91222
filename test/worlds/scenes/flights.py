"""A camera that flies among points or objects."""

import numpy as np

from semantic_slam import Detection, Engine, HybridBelief, Keyframe
from semantic_slam.geometry import se3, so3

DRIFT = np.array([0.004, 0.004, 0.01, 0.02, 0.02, 0.02])
"""Standard deviations of odometry, [rotation, translation]: gravity holds roll and pitch."""
RANGE_SIGMA, RAY_COVARIANCE = 0.05, np.diag([1e-4, 4e-4, 1e-4])
T_BODY_CAMERA = se3.exp(np.array([1.2, -1.2, 1.2, 0.1, -0.05, 0.1]))
HALF_VIEW_RAD = 0.8
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
OPTICAL = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
"""A body that looks along its z, as optical frames do."""


class Flight:
    """A camera that turns and moves on among ``points`` (n, 3); it knows its motion but for ``DRIFT``."""

    def __init__(
        self, random: np.random.Generator, points: np.ndarray, start: np.ndarray, T_ahead_body: np.ndarray = ORIGIN
    ) -> None:
        self.random, self.points, self.x, self.keyframe = random, points, start, 0
        self.T_ahead_body = T_ahead_body  # what the engine calls the body, seen from one that looks along its x

    def fly(self, engine: Engine, most: int, *, named: bool) -> HybridBelief:
        """The next keyframe, with the nearest points in view."""
        return engine.process(self.next(most, named=named))

    def next(self, most: int, *, named: bool, sigma_up_rad: float = 0.0) -> Keyframe:
        """The next keyframe; ``sigma_up_rad``: of gravity, 0: it does not measure any."""
        motion = se3.exp(np.array([0.0, 0.0, 0.35, 0.2, 0.0, 0.0]) + self.random.normal(scale=0.03, size=6))
        self.x = se3.retract(se3.compose(self.x, motion), self.random.normal(size=6) * DRIFT)
        body = self.T_ahead_body
        covariance = se3.covariance_along_parent(se3.inverse(body), np.diag(DRIFT**2))
        seen = self.seen(most, named=named)
        motion = se3.between(body, se3.compose(motion, body))
        told = {} if sigma_up_rad <= 0.0 else {"up": self._up(sigma_up_rad), "sigma_up_rad": sigma_up_rad}
        keyframe = Keyframe.spatial(self.keyframe, motion=motion, motion_covariance=covariance, detections=seen, **told)
        self.keyframe += 1
        return keyframe

    def _up(self, sigma_rad: float) -> np.ndarray:
        turn = se3.compose(self.x, self.T_ahead_body)[3:]
        return so3.matrix(turn)[2] + sigma_rad * self.random.normal(size=3)

    def seen(self, most: int, *, named: bool) -> list[Detection]:
        camera = se3.compose(self.x, T_BODY_CAMERA)
        away = so3.rotated(so3.inverse(camera[3:]), self.points - camera[:3])
        distance = np.linalg.norm(away, axis=1)
        near = [n for n in np.argsort(distance) if away[n, 2] > np.cos(HALF_VIEW_RAD) * distance[n]]
        return [self._detection(away[n], f"p{n}" if named else "", self.scores(n)) for n in near[:most]]

    def scores(self, number: int) -> dict[str, float]:
        """Of a point's class, none where nobody looks at it."""
        return {}

    def _detection(self, away: np.ndarray, name: str, scores: dict[str, float]) -> Detection:
        distance = np.linalg.norm(away)
        noise = np.linalg.cholesky(RAY_COVARIANCE) @ self.random.normal(size=3)
        return Detection.along(
            away / distance + noise,
            distance + RANGE_SIGMA * self.random.normal(),
            sigma_range_m=RANGE_SIGMA,
            ray_covariance=RAY_COVARIANCE,
            T_body_sensor=se3.between(self.T_ahead_body, T_BODY_CAMERA),
            track_id=name,
            class_scores=scores,
        )

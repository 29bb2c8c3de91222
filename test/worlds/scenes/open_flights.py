"""A camera that flies without a map among points, or upright bodies, of which it measures range and ray."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.models.spatial.camera import LOOKS_AHEAD, Camera
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.states.spaces import viewpoints_of
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

START = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
AHEAD = se3.exp(np.zeros(6))
BIRTHS = {"birth_density": 0.3, "occluder_radius_m": 0.05, "least_undetected_share": 0.001}


@dataclass(frozen=True)
class Errors:
    """Standard deviations of the odometry, [rotation, translation], of rays [rad] and of ranges [m]."""

    drift: tuple[float, ...] = (0.004, 0.004, 0.01, 0.02, 0.02, 0.02)
    ray: float = 0.01
    range_m: float = 0.03


FINE = Errors((1e-4,) * 6, 1e-4, 1e-3)
"""Errors with which it is known which view is of what, and from where."""
POOR = Errors((0.03, 0.03, 0.06, 0.1, 0.1, 0.1), 0.06, 0.15)
"""Errors with which one linearisation at the prediction does not do, and several histories stay live."""


class OpenFlight:
    """An engine and the camera that it follows, among 12 points of ``labels`` in turn."""

    def __init__(
        self,
        seed: int,
        T_ahead_body: np.ndarray = AHEAD,
        labels: Sequence[str] = (),
        errors: Errors = Errors(),
        objects: MapPrior | None = None,
        start: np.ndarray = START,
        **values: Any,
    ) -> None:
        self.random, self.errors, self.labels = np.random.default_rng(seed), errors, labels
        self.points, self.x = self.random.uniform([-2.0, -2.0, 0.0], [2.0, 2.0, 1.5], (12, 3)), start
        self.seen = set[int]()  # which of the points were detected at all
        self.T_ahead_body, self.camera = T_ahead_body, Camera(se3.between(T_ahead_body, LOOKS_AHEAD))
        kind = {"kind": "detector" if labels else "none", "labels": list(labels)}
        world = BIRTHS | values.pop("open_world", {})
        given = {"observation": "points", "semantic_model": kind, "pruning": {"max_hypotheses": 20}, **values}
        self.engine = Engine(
            Configuration.of(state_space="spatial", association="open", open_world=world, **given),
            objects,
            initial_pose=se3.compose(start, T_ahead_body),
            initial_covariance=1e-4 * np.eye(6),
        )
        self.region = SpatialRegion.of(self.engine.problem.open_world)

    def beliefs(self, keyframes: int, clutter: float = 0.0, rays: float = 0.0) -> Iterator[HybridBelief]:
        """The belief after each keyframe; with probability ``clutter`` something appears that is not there.

        ``rays``: share of the detections that have no range.
        """
        drift, self.rays = np.array(self.errors.drift), rays
        for k in range(keyframes):
            motion = se3.exp(np.array([0.0, 0.0, 0.3, 0.1, 0.0, 0.0]) + self.random.normal(scale=0.02, size=6))
            self.x = se3.retract(se3.compose(self.x, motion), self.random.normal(size=6) * drift)
            yield self.engine.process(
                Keyframe.spatial(
                    k,
                    motion=se3.between(self.T_ahead_body, se3.compose(motion, self.T_ahead_body)),
                    motion_covariance=se3.covariance_along_parent(se3.inverse(self.T_ahead_body), np.diag(drift**2)),
                    detections=self._detections(clutter),
                    T_body_camera=self.camera.T_body_camera,
                )
            )

    def _detections(self, clutter: float) -> list[Detection]:
        away = Camera().seen(so3.rotated(so3.inverse(self.x[3:]), self.points - self.x[:3]))
        found = []
        for n in np.flatnonzero(self.region.holds(away)).tolist():
            if self.random.random() > 0.9:
                continue
            self.seen.add(n)
            found.append(self._detection(away[n], n))
        if clutter and self.random.random() < clutter:
            found.append(self._detection(self.random.normal([0.0, 0.0, 2.0], 0.3), 0))
        return found

    def _detection(self, away: np.ndarray, n: int) -> Detection:
        distance = np.linalg.norm(away)
        ray = away / distance + self.errors.ray * self.random.normal(size=3)
        range_m = distance + self.errors.range_m * self.random.normal()
        has_range = not self.rays or self.random.random() > self.rays
        return Detection.along(
            ray,
            range_m if has_range else None,
            sigma_range_m=self.errors.range_m if has_range else None,
            ray_covariance=self.errors.ray**2 * np.eye(3),
            T_body_sensor=self.camera.T_body_camera,
            label=self.labels[n % len(self.labels)] if self.labels else "",
        )


class LookingFlight(OpenFlight):
    """A flight among bodies of two classes that look different from every side: a detection has scores of classes."""

    def __init__(self, seed: int, model: ParametricModel, **values: Any) -> None:
        self.model, self.looks = model, np.random.default_rng([seed, 1])
        self.yaws, self.classes = self.looks.uniform(-np.pi, np.pi, 12), self.looks.integers(0, 2, 12)
        self.views: list[
            tuple[int, np.ndarray, np.ndarray]
        ] = []  # of which body, the camera from it in map, and scores
        kind = {"kind": "parametric", "alpha": model.alpha, "concentration": model.concentration}
        named = {**kind, "class_names": list(model.class_names), "outlier_share": 0.0}
        super().__init__(seed, **{"observation": "range_bearing", "semantic_model": named, **values})

    def _detection(self, away: np.ndarray, n: int) -> Detection:
        camera = self.x[:3] - self.points[n]
        told = self.model.predict(self.classes[n : n + 1], from_around(camera, self.yaws[n : n + 1]))
        scores = told.mean[0] + np.linalg.cholesky(told.covariance[0]) @ self.looks.normal(size=2)
        self.views.append((n, camera, scores))
        named = dict(zip(self.model.class_names, scores.tolist(), strict=True))
        return replace(super()._detection(away, n), class_scores=named)


def from_around(camera: np.ndarray, yaws: np.ndarray) -> Viewpoints:
    """The viewpoints of a camera (3,), given from a body along the axes of map, if that is turned by ``yaws`` (B,)."""
    turns = np.zeros((len(yaws), 3))
    turns[:, 2] = -yaws
    return viewpoints_of(so3.rotated(so3.exp(turns), camera))

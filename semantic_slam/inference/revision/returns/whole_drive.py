"""A whole drive as one least-squares problem under any association; rough, to select histories to propose.

All histories share odometry and the correlated detection errors. With those errors integrated out, the geometry of a
history is sparse in the path, the odometry biases and the objects. The replay of a history determines its weight.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Self

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.correlated_errors import ErrorTransition, share_of
from semantic_slam.inference.models.noise.noise_settings import errors_under
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import STRETCH
from semantic_slam.inference.world.problem import Problem

NO_BIASES = np.zeros((3, 0))


@dataclass(frozen=True, kw_only=True)
class WholeDrive:
    """T motions, n detections with a range of objects that stand still, and M objects of a map."""

    begin: GaussianPrior  # prior of the robot before the first keyframe
    controls: Array  # (T, 3)
    by_bias: Array  # (T, 3, p)
    whiten: Array  # (T, 3, 3) whitening of motions, in their tangent spaces
    stretches: Index  # (T,) index of each motion's bias
    keyframes: Index  # (n,) of the detections
    numbers: Index  # (n,) number of each within its keyframe
    polar: Array  # (n, 2) range [m] and bearing [rad]
    polar_whiten: Array  # (n, 2, 2)
    covariance: Callable[[], Array]  # (2 n, 2 n) of whitened errors
    map_places: Array  # (M, 2)
    map_whiten: Array  # (M, 2, 2)

    @classmethod
    def of(cls, problem: Problem, component: Component, steps: Sequence[Step], standing: Sequence[Flags]) -> Self:
        """With the noise and clock offset that ``component`` assumes.

        ``standing``: for each keyframe (D,) which detections are of objects that stand still.
        """
        motions = [component.moved_by(step.motion) for step in steps]
        frames = [component.sensed(step.detections) for step in steps]
        rows = [
            (k, n, own)
            for k, frame in enumerate(frames)
            for n, own in enumerate(frame)
            if own.has_range and standing[k][n]
        ]
        entries = sorted(problem.objects, key=lambda entry: entry.object_id)
        priors = [entry.prior for entry in entries if entry.object_id not in component.elsewhere]
        spreads = np.array([_in_map(prior) for prior in priors]).reshape(-1, 2, 2)
        return cls(
            begin=problem.robot if problem.starts is None else problem.starts.prior(component.start),
            controls=np.array([motion.control for motion in motions]),
            by_bias=np.array([NO_BIASES if motion.by_bias is None else motion.by_bias for motion in motions]),
            whiten=_whitening(np.array([motion.covariance for motion in motions])),
            stretches=np.arange(len(steps)) // STRETCH,
            keyframes=np.array([k for k, _, _ in rows], dtype=int),
            numbers=np.array([n for _, n, _ in rows], dtype=int),
            polar=np.array([(own.range_m, own.bearing_rad) for _, _, own in rows]).reshape(-1, 2),
            polar_whiten=np.array([own.whiten for _, _, own in rows]).reshape(-1, 2, 2),
            covariance=partial(
                _errors,
                errors_under(component.noise_settings, problem.detection_errors),
                motions,
                frames,
                [row[:2] for row in rows],
            ),
            map_places=np.array([prior.mean[:2] for prior in priors]).reshape(-1, 2),
            map_whiten=_whitening(spreads),
        )

    @cached_property
    def information(self) -> Array:
        """(2 n, 2 n) information matrix of whitened errors; computed on demand, at cubic cost in the detections."""
        return _inverse(self.covariance())

    @property
    def num_biases(self) -> tuple[int, int]:
        """Number of bias variables, and of their components."""
        return int(self.stretches[-1]) + 1, self.by_bias.shape[-1]

    def seen_from(self, path: Array) -> Array:
        """(n, 2) positions of the detections in map, along a path (1 + T, 3)."""
        robots, (reach, bearing) = path[1 + self.keyframes], self.polar.T
        turn = robots[:, 2] + bearing
        return np.asarray(robots[:, :2] + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))


def _whitening(covariances: Array) -> Array:
    """(n, d, d) matrices that whiten errors."""
    return np.linalg.inv(np.linalg.cholesky(covariances)) if len(covariances) else covariances


def _inverse(covariance: Array) -> Array:
    """Inverse of a large covariance by Cholesky, at half the cost of a general inverse."""
    root, fault = dpotrf(covariance, lower=1) if len(covariance) else (covariance, 1)
    if fault:  # hardly definite, or there is nothing
        return np.asarray(np.linalg.inv(covariance), dtype=float)
    below = np.tril(dpotri(root, lower=1)[0])
    return np.asarray(below + np.tril(below, -1).T)


def _in_map(prior: GaussianPrior) -> Array:
    """(2, 2) position covariance, in map, of a pose or a point with a prior."""
    if len(prior.mean) < 3:
        return prior.covariance
    cos, sin = np.cos(prior.mean[2]), np.sin(prior.mean[2])
    turn = np.array([[cos, -sin], [sin, cos]])
    return np.asarray(turn @ prior.covariance[:2, :2] @ turn.T)


def _errors(
    settings: DetectionErrorsConfiguration,
    motions: Sequence[Motion],
    frames: Sequence[Sequence[Any]],
    rows: Sequence[tuple[int, int]],
) -> Array:
    """(2 n, 2 n) covariance of the whitened errors of the detections ``rows`` (keyframe, number in it)."""
    if settings.correlated_share <= 0.0:
        return np.eye(2 * len(rows))
    steps = _transitions(settings, motions, frames)
    sizes = [len(steps[k].mean) if k in steps else 0 for k in range(len(frames))]
    firsts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    repeated = np.zeros((int(firsts[-1]), int(firsts[-1])))
    for k, step in steps.items():
        now = slice(int(firsts[k]), int(firsts[k + 1]))
        repeated[now, now] = step.noise
        if step.before >= 0:
            before = slice(int(firsts[step.before]), int(firsts[step.before + 1]))
            cross = step.matrix @ repeated[before, : now.start]
            repeated[now, : now.start], repeated[: now.start, now] = cross, cross.T
            repeated[now, now] += cross[:, before] @ step.matrix.T
    kept = np.array([firsts[k] + 2 * n + part for k, n in rows for part in range(2)], dtype=int)
    share = share_of(settings)
    return np.asarray(share * repeated[np.ix_(kept, kept)] + (1.0 - share) * np.eye(len(kept)))


def _transitions(
    settings: DetectionErrorsConfiguration, motions: Sequence[Motion], frames: Sequence[Sequence[Any]]
) -> dict[int, ErrorTransition]:
    """Keyframe -> transition of the correlated errors to its detections from the last frame with any."""
    propagated, found = None, {}
    for k, (motion, frame) in enumerate(zip(motions, frames, strict=True)):
        propagated = None if propagated is None else propagated.moved(motion.control, settings)
        if frame:
            found[k] = ErrorTransition.of(settings, propagated, frame)
            propagated = found[k].after(k, np.zeros(len(found[k].mean)))
    return found

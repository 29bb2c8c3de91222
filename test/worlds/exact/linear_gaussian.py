"""A linear observation model over planar positions: beliefs and evidence are known in closed form."""

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.inference.models.observation import Linearisation
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.gaussian import GaussianPrior

LOG_2PI = np.log(2.0 * np.pi)


@dataclass(frozen=True)
class LinearDetection:
    geo: np.ndarray  # (2,) o - x + v
    sem: np.ndarray  # (2,) a_c + B_c (o - x) + e
    turn_variance = 0.0  # one linearisation holds everywhere


@dataclass(frozen=True)
class LinearDetections:
    geo: np.ndarray  # (B, 2)
    sem: np.ndarray  # (B, 2)

    def take(self, index):
        return LinearDetections(self.geo[index], self.sem[index])


@dataclass(frozen=True)
class LinearModel:
    geometric_covariance: np.ndarray  # (2, 2)
    semantic_covariance: np.ndarray  # (2, 2)
    offsets: np.ndarray  # (C, 2) a_c
    slopes: np.ndarray  # (C, 2, 2) B_c
    num_classes: int  # 0 leaves the semantics out

    def collect(self, detections):
        return LinearDetections(
            np.array([z.geo for z in detections]).reshape(-1, 2), np.array([z.sem for z in detections]).reshape(-1, 2)
        )

    def geometry(self, seen, x, o):
        count = len(x)
        eye = np.broadcast_to(np.eye(2), (count, 2, 2))
        return _whitened(o - x - _tiled(seen.geo, count), -eye, eye, self.geometric_covariance)

    def semantics(self, seen, x, o, classes):
        slope = self.slopes[classes]
        mean = self.offsets[classes] + (slope @ (o - x)[..., None])[..., 0]
        return _whitened(mean - _tiled(seen.sem, len(x)), -slope, slope, self.semantic_covariance)

    def log_likelihood(self, seen, x, o, classes):
        parts = [self.geometry(seen, x, o)] + ([] if classes is None else [self.semantics(seen, x, o, classes)])
        return sum(part.log_normaliser - 0.5 * (part.residual**2).sum(-1) for part in parts)

    def best_heading(self, seen, x, o, classes, sigma):
        peak = -0.5 * np.linalg.slogdet(2.0 * np.pi * self.semantic_covariance)[1]
        return np.full(len(classes), peak), np.zeros(len(classes))

    sees_everywhere = True

    def log_visibility(self, x, o, *, soft):
        return np.zeros(len(x))

    def robot_start(self, seen, x, o):
        return o - seen.geo

    def object_prior(self, detection, x):
        return GaussianPrior(x + detection.geo, np.eye(2))

    def geometry_factor(self, detection, keys):
        seen = self.collect([detection])
        return _factor(lambda x, o: self.geometry(seen, x, o), keys)

    def bearing_sigma(self, x, o, covariance, charts):
        return np.zeros(len(x))

    def view_change(self, before, now):
        return np.zeros(len(before))

    def least_cost(self, seen, x, covariance, o, sigmas):
        return np.zeros((len(x), len(seen.geo), o.shape[1])), 0.0


def _tiled(values, count):
    return np.tile(values, (count // len(values), 1))


def _whitened(residual, jacobian_x, jacobian_o, covariance):
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    log_normaliser = -0.5 * np.linalg.slogdet(covariance)[1] - LOG_2PI
    return Linearisation(
        residual=residual @ whiten.T,
        jacobian_robot=whiten @ jacobian_x,
        jacobian_object=whiten @ jacobian_o,
        log_normaliser=np.full(len(residual), log_normaliser),
    )


def _factor(part, keys):
    def error(this: Any, values: gtsam.Values, jacobians):
        keys = list(this.keys())
        x, o = (values.atPoint2(key)[None] for key in keys)
        linear = part(x, o)
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(linear.jacobian_robot[0])
            jacobians[1] = np.asfortranarray(linear.jacobian_object[0])
        return linear.residual[0]

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(2), list(keys), error)


class StepReader:
    """Steps made by hand; positions become poses without rotation."""

    def step(self, keyframe: Step) -> Step:
        return keyframe

    def poses(self, states):
        poses = np.zeros((*states.shape[:-1], 7))
        poses[..., :2], poses[..., 6] = states[..., :2], 1.0
        return poses

    def covariances(self, states, covariances):
        full = np.zeros((*states.shape[:-1], 6, 6))
        full[..., :2, :2] = covariances[..., :2, :2]
        return full

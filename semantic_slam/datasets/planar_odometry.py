"""Wheel odometry made from a true path: planar, with stated noise on every step."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class OdometryNoise:
    """Standard deviations of one step, independent between steps."""

    translation_per_m: float = 0.08  # of x and y each [m], per metre driven in that step
    rotation_per_m: float = 0.05  # of yaw [rad], per metre driven
    rotation_per_rad: float = 0.05  # of yaw [rad], per radian turned

    def describe(self) -> str:
        """One line for people."""
        return (
            f"odometry noise per step: {self.translation_per_m:g} m per metre in x and y,"
            f" {self.rotation_per_m:g} rad per metre and {self.rotation_per_rad:g} rad per radian in yaw"
        )


@dataclass(frozen=True)
class Odometry:
    """N poses in the odom frame, whose origin is the first."""

    poses: Array  # (N, 3) x y yaw
    covariances: Array  # (N, 3, 3) along the axes of odom


def simulate_odometry(truth: Array, noise: OdometryNoise, rng: np.random.Generator) -> Odometry:
    """Odometry of a robot that drove ``truth`` (N, 3), in map."""
    poses, covariances = [np.zeros(3)], [np.zeros((3, 3))]
    spread = np.zeros((3, 3))  # tangent space at the latest pose
    for before, after in pairwise(truth):
        step = se2.between(before, after)
        sigma = step_sigma(step, noise)
        measured = se2.compose(step, se2.exp(sigma * rng.standard_normal(3)))
        poses.append(se2.compose(poses[-1], measured))
        backwards = se2.inverse_adjoint(measured)
        spread = backwards @ spread @ backwards.T + np.diag(sigma**2)
        covariances.append(se2.rotate_covariance(poses[-1], spread))
    return Odometry(np.array(poses), np.array(covariances))


def step_sigma(step: Array, noise: OdometryNoise) -> Array:
    """(3,) standard deviations of x, y, yaw of one step (3,)."""
    distance, angle = float(np.hypot(step[0], step[1])), abs(float(step[2]))
    sideways = noise.translation_per_m * distance
    return np.array([sideways, sideways, noise.rotation_per_m * distance + noise.rotation_per_rad * angle])

"""Victoria Park as keyframes without landmark numbers: what the file says, thinned or blinded as an experiment asks."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.datasets.victoria_park import Log, Observation, stamps
from semantic_slam.datasets.victoria_park_import import measurements
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.odometry_bias import composed_slopes, slopes

FILE_VARIANCES = np.array([1e-4, 1e-4, 4e-6])
"""Variances of one odometry step in the file: x, y [m^2], yaw [rad^2]."""
LANDMARK_VARIANCE_M2 = 0.4
"""Variance of a trunk's position along each axis, as the file has it."""


@dataclass(frozen=True)
class Variant:
    """What is done to the data; nothing by default."""

    odometry_factor: float = 1.0  # on the file's odometry covariance
    landmark_variance_m2: float = LANDMARK_VARIANCE_M2
    dropped_share: float = 0.0  # of the detections, at random
    blind_m: float = 0.0  # length of each stretch without detections ...
    blind_every_m: float = 0.0  # ... and from the begin of one to that of the next
    seed: int = 0
    num_keyframes: int | None = None


@dataclass(frozen=True)
class Drive:
    """K keyframes with detections and, apart from them, the landmark numbers of the file."""

    keyframes: list[Keyframe]
    labels: list[tuple[str, ...]]  # (K,) of tuples (D,)
    positions: list[Array]  # (K,) of (D, 2) in the robot's frame
    controls: Array  # (K, 3) motion since the keyframe before
    covariances: Array  # (K, 3, 3) of it, in the tangent space at the newer pose
    duration_s: float


def make_drive(log: Log, variant: Variant) -> Drive:
    """Keyframes at detections alone; the odometry between them is composed, its covariance to first order."""
    seen = _kept(log, variant)
    stamps_ns = stamps(log.num_poses)
    variances = np.diag(FILE_VARIANCES * variant.odometry_factor)
    keyframes: list[Keyframe] = []
    labels: list[tuple[str, ...]] = []
    positions: list[Array] = []
    controls, covariances = [], []
    control, covariance, by_bias = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    by_bias_of_each = slopes(log.increments)
    for index, observations in enumerate(seen):
        if index:
            by_bias = composed_slopes(by_bias, log.increments[index - 1], by_bias_of_each[index - 1])
            control, covariance = _composed(control, covariance, log.increments[index - 1], variances)
        if not observations:
            continue
        own = np.array([observation.position for observation in observations])
        stamp_ns, number = int(stamps_ns[index]), len(keyframes)
        spread = covariance if index else variances
        frame = measurements(own, stamp_ns, number, variant.landmark_variance_m2)
        keyframes.append(
            Keyframe(
                index=number,
                stamp_ns=stamp_ns,
                odometry=pose_vector_from_planar(control),
                odometry_covariance=covariance_from_planar(spread),
                measurements=frame,
                odometry_slopes=by_bias,
            )
        )
        labels.append(tuple(observation.landmark for observation in observations))
        positions.append(own)
        controls.append(control)
        covariances.append(spread)
        control, covariance, by_bias = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
        if len(keyframes) == variant.num_keyframes:
            break
    duration = (keyframes[-1].stamp_ns - int(stamps_ns[0])) / 1e9
    return Drive(keyframes, labels, positions, np.array(controls), np.array(covariances), duration)


def _composed(control: Array, covariance: Array, increment: Array, variances: Array) -> tuple[Array, Array]:
    back = se2.inverse_adjoint(increment)
    return se2.compose(control, increment), back @ covariance @ back.T + variances


def _kept(log: Log, variant: Variant) -> list[list[Observation]]:
    """Detections by pose, without those that the experiment takes away."""
    random = np.random.default_rng(variant.seed)
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(log.increments[:, 0], log.increments[:, 1]))])
    kept = []
    for pose, observations in enumerate(log.by_pose()):
        stays = random.random(len(observations)) >= variant.dropped_share
        own = [item for item, stay in zip(observations, stays, strict=True) if stay]
        kept.append([] if _is_blind(float(travelled[pose]), variant) else own)
    return kept


def _is_blind(travelled_m: float, variant: Variant) -> bool:
    """The last part of every period, so that a drive begins with sight."""
    if variant.blind_m <= 0.0:
        return False
    return travelled_m % variant.blind_every_m >= variant.blind_every_m - variant.blind_m

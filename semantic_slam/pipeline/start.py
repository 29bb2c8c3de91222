"""Start of a run: its published configuration and its start pose."""

from collections.abc import Iterable

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.pipeline.detector_labels import with_labels
from semantic_slam.pipeline.gravity.imu_use import ANY_TILT_RAD, unused_because
from semantic_slam.pipeline.provenance import revision

TILT = [3, 4]
"""Indices of roll and pitch in the covariance, about the axes of the map frame."""


def announced_run(
    configuration: Configuration,
    map_prior: MapPrior | None,
    initial_pose: PoseEstimate | None,
    first: Keyframe,
    *,
    labels: Iterable[str],
    source: str,
    session: int = 0,
) -> RunConfiguration:
    """Configuration of the run that starts with the keyframe ``first`` and takes its stamp. Raises InputError.

    ``labels`` are the detector's known labels, ``source`` the JSON of the replayed input, ``session`` the index of the
    run within this process.
    """
    pose, covariance = start_of(configuration, initial_pose, first)
    return make_run_configuration(
        with_labels(configuration, first.measurements, map_prior, labels),
        map_prior,
        pose,
        covariance,
        stamp_ns=first.stamp_ns,
        source=source,
        revision=revision(),
        session=session,
    )


def start_of(configuration: Configuration, told: PoseEstimate | None, first: Keyframe) -> tuple[Array, Array]:
    """Start pose (7,) and covariance (6, 6), before the motion of the first keyframe. Raises InputError.

    A pose ``told`` by topic initialpose is taken unchanged. Otherwise a gravity measurement in the first keyframe gives
    the body's roll and pitch, unless it is less exact than :data:`ANY_TILT_RAD`. Since inference uses that measurement,
    too, the covariance of roll and pitch is widened to that value, so that it does not count twice. It is also widened
    where an IMU is there that told nothing so far, as later keyframes use its measurements.
    """
    if told is not None:
        return told.pose, told.covariance
    pose, covariance = initial_pose_of(configuration)
    if unused_because(configuration):
        return pose, covariance
    if first.level is None:
        return pose, without_tilt(covariance) if first.is_level_to_come else covariance
    has_tilt = first.level[3] <= ANY_TILT_RAD**2
    return (_tilted(pose, first) if has_tilt else pose), without_tilt(covariance)


def without_tilt(covariance: Array) -> Array:
    """(6, 6) covariance that says nothing of roll and pitch but that they are within :data:`ANY_TILT_RAD`."""
    wide = covariance.copy()
    wide[TILT] = wide[:, TILT] = 0.0
    wide[TILT, TILT] = ANY_TILT_RAD**2
    return wide


def _tilted(pose: Array, first: Keyframe) -> Array:
    """(7,) start pose with the roll and pitch of the gravity measurement in the first keyframe."""
    assert first.level is not None
    tilted = so3.upright(so3.rotated(first.odometry[3:], first.level[:3]))
    ahead = so3.matrix(pose[3:])[:, 0]
    yaw = so3.exp(np.array([0.0, 0.0, np.arctan2(ahead[1], ahead[0])]))
    return np.append(pose[:3], so3.product(yaw, tilted))

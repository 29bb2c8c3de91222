"""Start of a run: the configuration that is announced, and the pose at which it begins."""

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
from semantic_slam.pipeline.gravity.imu_use import unused_because
from semantic_slam.pipeline.provenance import revision

ANY_TILT_RAD = 0.5
"""Standard deviation of roll and pitch before the look that tells them."""
TILT = [3, 4]
"""Rows of roll and pitch, about the axes of map."""


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
    """The run that begins with the keyframe ``first``, whose stamp is the run's. Raises InputError.

    ``labels`` are the detector's known labels, ``source`` the JSON of what is replayed, ``session`` the number of the
    run among those of one process.
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
    """Pose (7,) and covariance (6, 6) before the motion of the first keyframe. Raises InputError.

    What is ``told`` by topic initialpose is taken as it is. Without that a look at gravity in the first keyframe says
    how the body was tilted; it counts once, so before it nothing is known of that.
    """
    if told is not None:
        return told.pose, told.covariance
    pose, covariance = initial_pose_of(configuration)
    if first.level is None or unused_because(configuration):
        return pose, covariance
    tilted = so3.upright(so3.rotated(first.odometry[3:], first.level[:3]))
    ahead = so3.matrix(pose[3:])[:, 0]
    yaw = so3.exp(np.array([0.0, 0.0, np.arctan2(ahead[1], ahead[0])]))
    wide = covariance.copy()
    wide[TILT] = wide[:, TILT] = 0.0
    wide[TILT, TILT] = ANY_TILT_RAD**2
    return np.append(pose[:3], so3.product(yaw, tilted)), wide

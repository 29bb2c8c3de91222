"""Builder of spatial sensing: range and ray (direction of sight) to points in R^3."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.inputs.spatial_reader import SpatialReader
from semantic_slam.inference.inputs.vector_reader import VectorReader
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.spatial.camera import LOOKS_AHEAD
from semantic_slam.inference.models.spatial.observation import POSES_AND_POINTS_IN_SPACE, SpatialObservation
from semantic_slam.inference.models.spatial.unmeasured_ranges import UnmeasuredRanges
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.planar_sensing import LEAST_VARIANCE, visibility_of
from semantic_slam.inference.world.sensing import Sensing, SensingSettings

HEIGHT = 2
"""Row of z in covariances of messages."""


def points(settings: SensingSettings) -> Sensing:
    """A robot in SE(3) among points in R^3."""
    configuration = settings.configuration
    return Sensing(
        spaces=POSES_AND_POINTS_IN_SPACE,
        model=SpatialObservation(
            visibility_of(configuration),
            configuration.new_objects,
            optical_axis(configuration.perception.extrinsics),
            configuration.detection_errors.ray_tail_sigmas,
        ),
        reader=SpatialReader(
            ConfiguredNoise(configuration.odometry, configuration.perception),
            words=WordReader(settings.labels) if settings.labels else None,
            ranges=UnmeasuredRanges.of(configuration),
            vectors=VectorReader(settings.vector_dimensions) if settings.vector_dimensions else None,
        ),
        robot_prior=pose_prior,
        object_prior=place_prior,
        joint_prior=joint_place_prior,
    )


def optical_axis(extrinsics: Sequence[float]) -> Array:
    """(3,) direction of the configured camera's optical axis in the body frame; the body's x if none is configured."""
    turn = np.asarray(extrinsics[3:] if len(extrinsics) else LOOKS_AHEAD[3:], dtype=np.float64)
    return so3.rotated(so3.normalised(turn), np.array([0.0, 0.0, 1.0]))


def pose_prior(pose: Array, covariance: Array) -> GaussianPrior:
    """Prior in the tangent space at the mean, from a covariance along the axes of map. Raises InputError."""
    if not se3.is_pose(pose):
        raise InputError("initial_pose: is no pose; give x y z [m] and a quaternion qx qy qz qw of unit length")
    mean = se3.wrapped(pose)
    return GaussianPrior(mean, se3.covariance_at_pose(mean, covariance) + LEAST_VARIANCE * np.eye(6))


def place_prior(pose: Array, covariance: Array) -> GaussianPrior:
    """Prior of a position in R^3; the orientation is ignored. Raises InputError for a planar map without heights."""
    place = covariance[:3, :3]
    check_height(place)
    return GaussianPrior(pose[:3], place + LEAST_VARIANCE * np.eye(3))


def check_height(place: Array) -> None:
    """Check the (3, 3) covariance of a position: raises InputError if only its height has no variance (planar map)."""
    if place[HEIGHT, HEIGHT] <= 0.0 < np.trace(place):
        raise InputError(
            "map prior: objects have no variance of their height, as one of the plane; give them one, in which"
            " state_space: spatial can find them"
        )


def joint_place_prior(poses: Array, covariance: Array) -> Array:
    """(3 n, 3 n) joint covariance of n positions; its diagonal blocks are :func:`place_prior`'s."""
    return np.asarray(covariance + LEAST_VARIANCE * np.eye(len(covariance)))

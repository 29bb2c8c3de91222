"""Builder of spatial sensing of objects with an orientation: range, ray and viewpoint."""

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.inputs.score_features import FeatureReader
from semantic_slam.inference.inputs.spatial_reader import SpatialReader
from semantic_slam.inference.inputs.vector_reader import VectorReader
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.spatial.bodies import BodyObservation
from semantic_slam.inference.models.spatial.unmeasured_ranges import UnmeasuredRanges
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE, SpatialViews
from semantic_slam.inference.models.view_scores import ViewScores
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.planar_sensing import LEAST_VARIANCE, visibility_of
from semantic_slam.inference.world.sensing import PriorReader, Sensing, SensingSettings
from semantic_slam.inference.world.spatial_sensing import check_height, optical_axis, pose_prior

TILT = slice(3, 5)
"""Rows of roll and pitch, about the axes of map, in covariances of messages."""


def range_bearing(settings: SensingSettings) -> Sensing:
    """Robot and upright objects in SE(3); class scores depend on the azimuth and elevation from which one is seen."""
    configuration = settings.configuration
    axis, visibility = optical_axis(configuration.perception.extrinsics), visibility_of(configuration)
    return Sensing(
        spaces=POSES_IN_SPACE,
        model=BodyObservation(
            visibility,
            configuration.new_objects,
            axis,
            configuration.detection_errors.ray_tail_sigmas,
            scores=_scores(settings),
        ),
        reader=SpatialReader(
            ConfiguredNoise(configuration.odometry, configuration.perception),
            words=WordReader(settings.labels) if settings.labels else None,
            ranges=UnmeasuredRanges.of(configuration),
            features=FeatureReader(settings.num_features, settings.feature_names),
            vectors=VectorReader(settings.vector_dimensions) if settings.vector_dimensions else None,
        ),
        robot_prior=pose_prior,
        object_prior=_body_prior(configuration.new_objects.sigma_tilt_rad),
        joint_prior=joint_body_prior,
    )


def joint_body_prior(poses: Array, covariance: Array) -> Array:
    """Raise InputError: the joint covariance of a FILE.map of space is over positions, and has no attitudes."""
    raise InputError(
        "map prior: a FILE.map of space has no attitudes in common; write it with semantic_slam map save --marginals,"
        " or give an objects.json"
    )


def _scores(settings: SensingSettings) -> ViewScores | None:
    if settings.class_model is None:
        return None
    return ViewScores(SpatialViews(), settings.class_model, settings.tempering, settings.outliers)


def _body_prior(sigma_tilt_rad: float) -> PriorReader:
    """Prior of objects that gravity keeps upright: ``sigma_tilt_rad`` is added to their roll and pitch uncertainty."""

    def prior(pose: Array, covariance: Array) -> GaussianPrior:
        check_height(covariance[:3, :3])
        if not se3.is_pose(pose):
            raise InputError("map prior: an object has no pose; give x y z [m] and a quaternion of unit length")
        held = covariance.copy()
        held[TILT, TILT] += sigma_tilt_rad**2 * np.eye(2)
        mean = se3.wrapped(pose)
        return GaussianPrior(mean, se3.covariance_at_pose(mean, held) + LEAST_VARIANCE * np.eye(6))

    return prior

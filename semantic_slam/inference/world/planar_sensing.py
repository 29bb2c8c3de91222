"""Builders of planar sensing: range and bearing to objects that are SE(2) poses, or points."""

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.geometry.se2 import rotate_covariance, sine_cosine
from semantic_slam.inference.inputs.planar_reader import PlanarReader
from semantic_slam.inference.inputs.vector_reader import VectorReader
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.odometry_bias import bias_means, bias_sigmas
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE, PlanarObservation
from semantic_slam.inference.models.planar.point_observation import POSES_AND_POINTS, PointObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.sensing import Sensing, SensingSettings

LEAST_VARIANCE = 1e-9
"""Added to the variances of priors, so that the system stays regular with a map that is stated as exact."""


def range_bearing(settings: SensingSettings) -> Sensing:
    """Robot and objects in SE(2); class scores depend on the azimuth from which an object is seen."""
    configuration = settings.configuration
    new_objects, visibility = configuration.new_objects, visibility_of(configuration)
    return Sensing(
        spaces=POSES_IN_PLANE,
        model=PlanarObservation(settings.class_model, visibility, new_objects, settings.tempering, settings.outliers),
        reader=_reader(settings),
        robot_prior=planar_prior,
        object_prior=planar_prior,
        joint_prior=joint_planar_prior,
    )


def points(settings: SensingSettings) -> Sensing:
    """Robot in SE(2) among points in R^2. Raises InputError for class models, which need headings, or an open world."""
    if settings.num_features:
        raise InputError(
            "observation: points have no heading, from which class models would be seen; set semantic_model.kind: none"
        )
    if settings.tracks_objects:
        raise InputError(
            "observation: points are not born and lost yet; set association: enumerated, or given with"
            " open_world.iterate_updates: true"
        )
    return Sensing(
        spaces=POSES_AND_POINTS,
        model=PointObservation(visibility_of(settings.configuration), settings.configuration.new_objects),
        reader=_reader(settings),
        robot_prior=planar_prior,
        object_prior=point_prior,
        joint_prior=joint_point_prior,
    )


def planar_prior(pose: Array, covariance: Array) -> GaussianPrior:
    """Prior in the tangent space at the mean, from a covariance along the axes of map."""
    mean = planar_from_pose_vector(pose)
    planar = rotate_covariance(mean, planar_from_covariance(covariance), to_parent=False)
    return GaussianPrior(mean, planar + LEAST_VARIANCE * np.eye(3))


def point_prior(pose: Array, covariance: Array) -> GaussianPrior:
    """Prior of a position in R^2; the heading is ignored."""
    place = planar_from_covariance(covariance)[:2, :2]
    return GaussianPrior(planar_from_pose_vector(pose)[:2], place + LEAST_VARIANCE * np.eye(2))


def joint_planar_prior(poses: Array, covariance: Array) -> Array:
    """(3 n, 3 n) joint covariance in the tangent spaces at n poses; its diagonal blocks are :func:`planar_prior`'s."""
    turns = np.zeros((len(poses), 3, 3))
    sine, cosine = sine_cosine(planar_from_pose_vector(poses)[:, 2])
    turns[:, 0, 0] = turns[:, 1, 1] = cosine
    turns[:, 0, 1], turns[:, 1, 0], turns[:, 2, 2] = sine, -sine, 1.0
    blocks = covariance.reshape(len(poses), 3, len(poses), 3)
    turned = np.einsum("iab,ibjc,jdc->iajd", turns, blocks, turns).reshape(covariance.shape)
    return np.asarray(turned + LEAST_VARIANCE * np.eye(len(turned)))


def joint_point_prior(poses: Array, covariance: Array) -> Array:
    """(2 n, 2 n) joint covariance of n positions; headings are ignored."""
    rows = np.arange(3 * len(poses)).reshape(-1, 3)[:, :2].ravel()
    return np.asarray(covariance[np.ix_(rows, rows)] + LEAST_VARIANCE * np.eye(len(rows)))


def visibility_of(configuration: Configuration) -> PlanarVisibility:
    """The visibility model P(beta | x, O) of the configuration."""
    settings = configuration.visibility
    return PlanarVisibility(settings.max_range_m, settings.field_of_view_rad, settings.softness)


def _reader(settings: SensingSettings) -> PlanarReader:
    configuration = settings.configuration
    return PlanarReader(
        settings.num_features,
        bias_sigmas(configuration.odometry),
        settings.feature_names,
        ConfiguredNoise(configuration.odometry, configuration.perception),
        bias_means=bias_means(configuration.odometry),
        learns_region=configuration.open_world.learn_region,
        region_within_m=configuration.open_world.learn_region_within_m,
        words=WordReader(settings.labels) if settings.labels else None,
        vectors=VectorReader(settings.vector_dimensions) if settings.vector_dimensions else None,
    )

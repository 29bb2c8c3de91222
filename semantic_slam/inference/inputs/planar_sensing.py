"""Range, bearing and class scores of objects with a place and a heading, seen by a robot in the plane."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.geometry.se2 import rotate_covariance
from semantic_slam.inference.inputs.planar_reader import PlanarReader
from semantic_slam.inference.models.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.odometry_bias import bias_sigmas
from semantic_slam.inference.models.planar_observation import PlanarObservation
from semantic_slam.inference.models.visibility import PlanarVisibility
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.sensing import Sensing, SensingSettings

LEAST_VARIANCE = 1e-9
"""Added to the variances of priors, so that a map given as exact keeps the graph regular."""


def range_bearing(settings: SensingSettings) -> Sensing:
    """Robot and objects in SE(2)."""
    configuration, visibility = settings.configuration, settings.configuration.visibility
    noise = ConfiguredNoise(configuration.odometry, configuration.perception)
    biases = bias_sigmas(configuration.odometry).tolist()
    return Sensing(
        spaces=Spaces.same(PlanarPoses()),
        model=PlanarObservation(
            settings.class_model,
            PlanarVisibility(visibility.max_range_m, visibility.field_of_view_rad, visibility.softness),
            configuration.new_objects,
            settings.tempering,
        ),
        reader=PlanarReader(settings.num_features, biases, settings.feature_names, noise),
        robot_prior=planar_prior,
        object_prior=planar_prior,
    )


def planar_prior(pose: Array, covariance: Array) -> GaussianPrior:
    """Prior in the tangent space at the mean, from a covariance along the axes of map."""
    mean = planar_from_pose_vector(pose)
    planar = rotate_covariance(mean, planar_from_covariance(covariance), to_parent=False)
    return GaussianPrior(mean, planar + LEAST_VARIANCE * np.eye(3))

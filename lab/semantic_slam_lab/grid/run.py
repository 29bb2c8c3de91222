"""A grid world as the engine is given it: a run's announcement and keyframes, the default configuration."""

import numpy as np

from semantic_slam.configuration import from_dict
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.geometry.se2 import rotate_covariance
from semantic_slam.inference.building import make_run_configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam_lab.grid.world import Frame, World

CLASS_NAMES = ("class_1", "class_2")
MEASUREMENT_RANGE_LIMIT = 1e-3
"""Metres: a drawn range is not negative."""


def run_of(world: World, *, semantics: bool = True) -> RunConfiguration:
    """The default configuration but for what the world defines: classes, visibility, neither clutter nor outliers."""
    sensor = world.sensor
    model = {
        "kind": "parametric",
        "alpha": sensor.alpha,
        "concentration": sensor.concentration,
        "outlier_share": 0.0,
    }
    limits = {"max_range_m": sensor.max_range_m, "field_of_view_rad": sensor.field_of_view_rad}
    configuration = from_dict(
        {
            "semantic_model": model if semantics else {"kind": "none"},
            "visibility": limits,
            "closed_world": {"clutter_per_frame": 0.0},
        }
    )
    objects = tuple(
        ObjectPrior(
            object_id=i,
            name=str(i),
            pose=pose_vector_from_planar(mean),
            covariance=_in_map(mean, world.noise.objects),
            class_probabilities={},
        )
        for i, mean in enumerate(world.object_means)
    )
    return make_run_configuration(
        configuration,
        MapPrior(objects),
        pose_vector_from_planar(world.robot_mean),
        _in_map(world.robot_mean, world.noise.robot),
        stamp_ns=10**9,
    )


def keyframes_of(world: World) -> list[Keyframe]:
    """One keyframe per frame, a second apart."""
    covariance = covariance_from_planar(np.diag(world.noise.motion))
    return [
        Keyframe(
            index=k,
            stamp_ns=(k + 1) * 10**9,
            odometry=pose_vector_from_planar(frame.control),
            odometry_covariance=covariance,
            measurements=_measurements(k, frame, world),
        )
        for k, frame in enumerate(world.frames)
    ]


def _in_map(mean: Array, variances: tuple[float, ...]) -> Array:
    return covariance_from_planar(rotate_covariance(mean, np.diag(variances)))


def _measurements(sequence: int, frame: Frame, world: World) -> SemanticMeasurements:
    count = len(frame.objects)
    return SemanticMeasurements(
        stamp_ns=(sequence + 1) * 10**9,
        sequence=sequence,
        frame_id="base_link",
        class_names=CLASS_NAMES,
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.zeros((count, 4)),
        labels=("object",) * count,
        scores=np.ones(count),
        track_ids=("",) * count,
        class_probability_samples=np.zeros((count, 1, 2)),
        features=frame.features,
        feature_covariances=np.zeros((count, 2, 2)),
        predictive_entropy=np.zeros(count),
        mutual_information=np.zeros(count),
        ranges_m=np.maximum(frame.geometry[:, 0], MEASUREMENT_RANGE_LIMIT),
        bearings_rad=frame.geometry[:, 1],
        geometric_covariances=np.tile(np.diag(world.noise.geometry), (count, 1, 1)),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )

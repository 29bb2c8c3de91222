"""A grid world as the engine is given it: a run's announcement and keyframes, the default configuration.

In space the world is the same, and level: the robot does not know its height and how it is tilted, nor the objects'.
"""

from dataclasses import dataclass

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


HEIGHT_VARIANCE, TILT_VARIANCE = 0.01, 0.0004
"""In space, of robot and objects before the first keyframe [m^2, rad^2]; of a motion so many times less."""
MOTION_SHARE = 0.1


@dataclass(frozen=True)
class Setting:
    """What of a world is estimated."""

    observation: str = "range_bearing"
    semantics: bool = True
    is_spatial: bool = False

    def aside(self) -> Array:
        """(6, 6) over x y z rx ry rz: of what is not in the plane."""
        return np.diag([0.0, 0.0, HEIGHT_VARIANCE, TILT_VARIANCE, TILT_VARIANCE, 0.0]) * self.is_spatial


def run_of(world: World, setting: Setting | None = None) -> RunConfiguration:
    """The default configuration but for what the world defines: classes, visibility, neither clutter nor outliers."""
    sensor, setting = world.sensor, setting or Setting()
    model = {
        "kind": "parametric",
        "alpha": sensor.alpha,
        "concentration": sensor.concentration,
        "outlier_share": 0.0,
    }
    limits = {"max_range_m": sensor.max_range_m, "field_of_view_rad": sensor.field_of_view_rad}
    configuration = from_dict(
        {
            "state_space": "spatial" if setting.is_spatial else "planar",
            "observation": setting.observation,
            "semantic_model": model if setting.semantics else {"kind": "none"},
            "visibility": limits,
            "closed_world": {"clutter_per_frame": 0.0},
        }
    )
    objects = tuple(
        ObjectPrior(
            object_id=i,
            name=str(i),
            pose=pose_vector_from_planar(mean),
            covariance=_in_map(mean, world.noise.objects) + setting.aside(),
            class_probabilities={},
        )
        for i, mean in enumerate(world.object_means)
    )
    return make_run_configuration(
        configuration,
        MapPrior(objects),
        pose_vector_from_planar(world.robot_mean),
        _in_map(world.robot_mean, world.noise.robot) + setting.aside(),
        stamp_ns=10**9,
    )


def keyframes_of(world: World, setting: Setting | None = None) -> list[Keyframe]:
    """One keyframe per frame, a second apart."""
    aside = MOTION_SHARE * (setting or Setting()).aside()
    covariance = covariance_from_planar(np.diag(world.noise.motion)) + aside
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
        elevations_rad=np.zeros(count),
        place_covariances=np.tile(np.diag([*world.noise.geometry, world.noise.geometry[1]]), (count, 1, 1)),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )

"""A small room without a map, with clutter, misses and identical objects: truth and every association are known."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import from_dict
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.building import make_run_configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

OBJECTS = np.array(
    [[3.0, 1.5, 2.6], [3.0, -1.5, -2.0], [5.0, 0.8, 0.4], [6.0, -1.8, 1.2], [1.0, 3.0, -0.6], [-1.5, 2.0, 0.3]]
)
SIGMA_RANGE, SIGMA_BEARING = 0.1, 0.03
SIGMA_STEP = np.array([0.02, 0.02, 0.01])
REGION = {"min_range_m": 0.3, "max_range_m": 5.0, "field_of_view_rad": 1.6}


@dataclass(frozen=True)
class Room:
    run: RunConfiguration
    keyframes: list[Keyframe]
    truth: np.ndarray  # (K, 3)
    associations: list[tuple[int, ...]]  # -1 clutter


def make_room(
    num_keyframes: int = 30,
    seed: int = 0,
    detection_probability: float = 0.9,
    clutter: float = 0.3,
    semantic: bool = False,
    map_prior: MapPrior | None = None,
    **overrides: object,
) -> Room:
    """The robot turns on a circle of 1 m; ``clutter`` false alarms a frame."""
    random = np.random.default_rng(seed)
    open_world = {
        "detection_probability": detection_probability,
        "clutter_per_frame": max(clutter, 1e-3),
        **REGION,
        **overrides.pop("open_world", {}),
    }
    kind = {"kind": "parametric"} if semantic else {"kind": "none"}
    values = {"association": "open", "semantic_model": kind, "open_world": open_world, **overrides}
    run = make_run_configuration(
        from_dict(values),
        map_prior,
        pose_vector_from_planar(np.zeros(3)),
        covariance_from_planar(np.diag([0.01, 0.01, 0.001]) ** 2),
        stamp_ns=10**9,
    )
    x, truth, keyframes, associations = np.zeros(3), [], [], []
    step = np.array([0.25, 0.0, 0.25])
    for k in range(num_keyframes):
        x = se2.compose(se2.compose(x, step), se2.exp(random.normal(size=3) * SIGMA_STEP))
        points, labels = _detected(x, random, detection_probability, clutter)
        odometry = (pose_vector_from_planar(step), covariance_from_planar(np.diag(SIGMA_STEP**2)))
        keyframes.append(
            Keyframe(
                index=k,
                stamp_ns=(k + 1) * 10**9,
                odometry=odometry[0],
                odometry_covariance=odometry[1],
                measurements=_measurements(k, x, points, labels, random, semantic),
            )
        )
        truth.append(x)
        associations.append(labels)
    return Room(run, keyframes, np.array(truth), associations)


def _detected(
    x: np.ndarray, random: np.random.Generator, probability: float, clutter: float
) -> tuple[np.ndarray, tuple[int, ...]]:
    """(D, 2) range and bearing, and which object each is of."""
    relative = se2.between(np.broadcast_to(x, OBJECTS.shape), OBJECTS)
    polar = np.stack([np.hypot(relative[:, 0], relative[:, 1]), np.arctan2(relative[:, 1], relative[:, 0])], axis=1)
    half = 0.5 * REGION["field_of_view_rad"]
    inside = (polar[:, 0] < 5.0) & (polar[:, 0] > 0.3) & (np.abs(polar[:, 1]) < half)
    seen = np.flatnonzero(inside & (random.random(len(OBJECTS)) < probability))
    noisy = polar[seen] + random.normal(size=(len(seen), 2)) * [SIGMA_RANGE, SIGMA_BEARING]
    false = random.poisson(clutter)
    ranges = np.sqrt(random.uniform(0.09, 25.0, size=false))
    alarms = np.stack([ranges, random.uniform(-half, half, size=false)], axis=1)
    return np.concatenate([noisy, alarms]), (*(int(n) for n in seen), *([-1] * false))


def _measurements(
    sequence: int,
    x: np.ndarray,
    polar: np.ndarray,
    labels: tuple[int, ...],
    random: np.random.Generator,
    semantic: bool,
) -> SemanticMeasurements:
    count = len(polar)
    model = ParametricModel(0.25, 15.0)
    features = np.zeros((count, model.num_features if semantic else 0))
    for row, number in enumerate(labels if semantic else ()):
        o = OBJECTS[number] if number >= 0 else np.array([x[0] + 1.0, x[1] + 1.0, random.uniform(-3.0, 3.0)])
        camera = se2.between(o, x)
        view = Viewpoints(np.array([np.arctan2(camera[1], camera[0])]), np.zeros(1), np.ones(1))
        prediction = model.predict(np.array([max(number, 0) % 2]), view)
        features[row] = random.multivariate_normal(prediction.mean[0], prediction.covariance[0])
    size = features.shape[1]
    return SemanticMeasurements(
        stamp_ns=(sequence + 1) * 10**9,
        sequence=sequence,
        frame_id="base_link",
        class_names=model.class_names if semantic else (),
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.zeros((count, 4)),
        labels=("object",) * count,
        scores=np.ones(count),
        track_ids=("",) * count,
        class_probability_samples=np.zeros((count, 1, size)),
        features=features,
        feature_covariances=np.zeros((count, size, size)),
        predictive_entropy=np.zeros(count),
        mutual_information=np.zeros(count),
        ranges_m=polar[:, 0],
        bearings_rad=polar[:, 1],
        geometric_covariances=np.tile(np.diag([SIGMA_RANGE**2, SIGMA_BEARING**2]), (count, 1, 1)),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )

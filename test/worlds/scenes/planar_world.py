"""A small planar world that follows the engine's own models: poses, objects, classes and associations are known."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration, from_dict
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

OBJECTS = np.array([[3.0, 1.5, 2.6], [3.0, -1.5, -2.0], [6.0, 1.5, 0.4], [6.0, -1.5, 1.2], [9.5, 0.5, -0.6]])
SIGMA_RANGE, SIGMA_BEARING = 0.1, 0.05
STEP = np.array([0.5, 0.0, 0.02])
SIGMA_STEP = np.array([0.02, 0.02, 0.01])
OBJECT_VARIANCE = np.array([0.05, 0.05, 0.0005])


@dataclass(frozen=True)
class World:
    run: RunConfiguration
    keyframes: list[Keyframe]
    truth: np.ndarray  # (K, 3)
    associations: list[tuple[int, ...]]


def make_world(
    num_keyframes: int = 12,
    seed: int = 0,
    sigma_start_m: float = 10.0,
    sigma_heading_rad: float | None = None,
    **overrides: object,
) -> World:
    """A robot lost by ``sigma_start_m`` drives past OBJECTS, all of class 1; ``overrides`` are configuration."""
    random = np.random.default_rng(seed)
    configuration = from_dict({"semantic_model": {"kind": "parametric"}, **overrides})
    start = np.array([-0.5, 0.0, 0.0])
    prior_mean = start + (
        np.array([4.0, -3.0, 0.1]) if sigma_start_m > 1.0 or configuration.association == "given" else 0.0
    )
    covariance = covariance_from_planar(np.diag([sigma_start_m**2, sigma_start_m**2, 0.04]))
    prior = None if configuration.association == "given" else _map_prior(random, sigma_heading_rad)
    run = make_run_configuration(configuration, prior, pose_vector_from_planar(prior_mean), covariance, stamp_ns=10**9)
    x, truth, keyframes, associations = start, [], [], []
    for k in range(num_keyframes):
        noise = se2.exp(random.normal(size=3) * SIGMA_STEP)
        x = se2.compose(se2.compose(x, STEP), noise)
        seen = _visible(x)
        measurements = _measurements(k, x, seen, random, configuration)
        odometry = (pose_vector_from_planar(STEP), covariance_from_planar(np.diag(SIGMA_STEP**2)))
        keyframes.append(
            Keyframe(
                index=k,
                stamp_ns=(k + 1) * 10**9,
                odometry=odometry[0],
                odometry_covariance=odometry[1],
                measurements=measurements,
            )
        )
        truth.append(x)
        associations.append(tuple(int(n) for n in seen))
    return World(run, keyframes, np.array(truth), associations)


def _map_prior(random: np.random.Generator, sigma_heading_rad: float | None) -> MapPrior:
    variance = OBJECT_VARIANCE if sigma_heading_rad is None else np.array([0.05, 0.05, sigma_heading_rad**2])
    covariance = covariance_from_planar(np.diag(variance))
    objects = []
    for number, truth in enumerate(OBJECTS):
        mean = se2.compose(truth, se2.exp(random.normal(size=3) * np.sqrt(variance)))
        objects.append(
            ObjectPrior(
                object_id=number,
                name=f"object_{number}",
                pose=pose_vector_from_planar(mean),
                covariance=covariance,
                class_probabilities={},
            )
        )
    return MapPrior(tuple(objects))


def _noise(random: np.random.Generator, seen: np.ndarray, covariances: np.ndarray, *, shared: bool) -> np.ndarray:
    """Errors of the features; ``shared``: every view of an object repeats its error, whatever the direction."""
    if not shared:
        return np.array([random.multivariate_normal(np.zeros(len(c)), c) for c in covariances])
    normals = [np.random.default_rng(int(n)).standard_normal(covariances.shape[-1]) for n in seen]
    return np.array([np.linalg.cholesky(c) @ normal for c, normal in zip(covariances, normals, strict=True)])


def _visible(x: np.ndarray) -> np.ndarray:
    relative = se2.between(np.broadcast_to(x, OBJECTS.shape), OBJECTS)
    distance, bearing = np.hypot(relative[:, 0], relative[:, 1]), np.arctan2(relative[:, 1], relative[:, 0])
    nearest = np.argsort(distance)
    return np.array([n for n in nearest if distance[n] < 5.0 and abs(bearing[n]) < 1.2][:2], dtype=int)


def _measurements(
    sequence: int, x: np.ndarray, seen: np.ndarray, random: np.random.Generator, configuration: Configuration
) -> SemanticMeasurements:
    count = len(seen)
    relative = se2.between(np.broadcast_to(x, (count, 3)), OBJECTS[seen])
    camera = se2.between(OBJECTS[seen], np.broadcast_to(x, (count, 3)))
    settings = configuration.semantic_model
    model = load_model(settings) or ParametricModel(settings.alpha, settings.concentration)
    size = model.num_features
    views = Viewpoints(np.arctan2(camera[:, 1], camera[:, 0]), np.zeros(count), np.hypot(camera[:, 0], camera[:, 1]))
    prediction = model.predict(np.zeros(count, dtype=int), views)
    noise = _noise(random, seen, prediction.covariance, shared=configuration.semantic_model.kind == "gp_correlated")
    noise_geometric = random.normal(size=(count, 2)) * [SIGMA_RANGE, SIGMA_BEARING]
    given = configuration.association == "given"
    return SemanticMeasurements(
        stamp_ns=(sequence + 1) * 10**9,
        sequence=sequence,
        frame_id="base_link",
        class_names=model.class_names,
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.zeros((count, 4)),
        labels=("object",) * count,
        scores=np.ones(count),
        track_ids=tuple(f"tree_{n}" for n in seen) if given else ("",) * count,
        class_probability_samples=np.zeros((count, 1, size)),
        features=prediction.mean + noise.reshape(count, size),
        feature_covariances=np.zeros((count, size, size)),
        predictive_entropy=np.zeros(count),
        mutual_information=np.zeros(count),
        ranges_m=np.hypot(relative[:, 0], relative[:, 1]) + noise_geometric[:, 0],
        bearings_rad=np.arctan2(relative[:, 1], relative[:, 0]) + noise_geometric[:, 1],
        geometric_covariances=np.tile(np.diag([SIGMA_RANGE**2, SIGMA_BEARING**2]), (count, 1, 1)),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )


def beliefs(world: World, num_backends: int) -> list[HybridBelief]:
    """After every keyframe, with some backends in this process."""
    manager = Engine.of_run(world.run, InProcessPool(num_backends))
    return [manager.process(keyframe) for keyframe in world.keyframes]

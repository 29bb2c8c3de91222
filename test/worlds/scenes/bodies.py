"""A robot among three upright objects of two classes, in the plane and in space that is as flat."""

import numpy as np
from worlds.exact.spatial_fixtures import NOTHING_LEFT_OUT

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import pose_vector_from_planar, wrap_angle
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

NAMES = ("class_1", "class_2")
MODEL = ParametricModel(0.6, 6.0, NAMES)
OBJECTS = np.array([[2.0, 1.0, 0.5], [2.3, -0.6, 2.0], [3.4, 0.4, -1.5]])
CLASSES = (0, 1, 0)
OBJECT_VARIANCES = np.array([0.05, 0.05, 0.04])
START, START_VARIANCES = np.array([0.1, -0.1, 0.2]), np.array([0.2, 0.2, 0.05])
STEP, STEP_VARIANCES = np.array([0.5, 0.05, 0.15]), np.array([0.0025, 0.0025, 0.0009])
RANGE_SIGMA, BEARING_SIGMA = 0.35, 0.3
SEEN = ((0, 1), (2, 0))
PINNED = 1e-9
"""Variance of height, roll and pitch."""
IN_PLANE = [0, 1, 5]
"""Rows of x, y and yaw among x y z rx ry rz."""

Frame = list[tuple[float, float, str, dict[str, float]]]


def drive(random: np.random.Generator, *, named: bool) -> list[Frame]:
    """Range, bearing, name and class scores of what a robot sees that drives as odometry has it."""
    x, frames = se2.compose(START, np.array([0.2, 0.1, 0.05])), []
    root = np.linalg.cholesky(MODEL.predict(np.zeros(1, dtype=int), _level(0.0)).covariance[0])
    for seen in SEEN:
        x, frame = se2.compose(x, STEP), []
        for n in seen:
            body = se2.between(x, OBJECTS[n])[:2]
            camera = se2.between(OBJECTS[n], x)[:2]
            mean = MODEL.predict(np.array([CLASSES[n]]), _level(np.arctan2(camera[1], camera[0]))).mean[0]
            scores = dict(zip(NAMES, mean + root @ random.normal(size=2), strict=True))
            distance = np.hypot(*body) + RANGE_SIGMA * random.normal()
            bearing = wrap_angle(np.arctan2(body[1], body[0]) + BEARING_SIGMA * random.normal())
            frame.append((float(distance), float(bearing), f"object_{n}" if named else "", scores))
        frames.append(frame)
    return frames


def _level(azimuth: float) -> Viewpoints:
    return Viewpoints(np.array([azimuth]), np.zeros(1), np.ones(1))


def configured(kind: dict, **values: object) -> Configuration:
    """Of a run that leaves nothing out."""
    return Configuration.of(semantic_model=kind, **{**NOTHING_LEFT_OUT, **values})


def planar_run(frames: list[Frame], kind: dict, **values: object) -> tuple[Engine, HybridBelief]:
    """In the plane."""
    sigmas = np.sqrt(OBJECT_VARIANCES)
    prior = MapPrior(
        tuple(ObjectPrior.planar(n, *o, sigma_m=sigmas[0], sigma_rad=sigmas[2]) for n, o in enumerate(OBJECTS))
    )
    engine = Engine(
        configured(kind, **values),
        prior,
        initial_pose=START,
        initial_covariance=np.diag(START_VARIANCES),
    )
    for k, frame in enumerate(frames):
        noise = np.diag([RANGE_SIGMA, BEARING_SIGMA]) ** 2
        seen = [
            Detection(range_m=r, bearing_rad=b, covariance=noise, track_id=name, class_scores=scores)
            for r, b, name, scores in frame
        ]
        belief = engine.process(Keyframe.planar(k, motion=STEP, motion_sigmas=np.sqrt(STEP_VARIANCES), detections=seen))
    return engine, belief


def level_run(frames: list[Frame], kind: dict, **values: object) -> tuple[Engine, HybridBelief]:
    """In space, with height, roll and pitch known."""
    configuration = configured(
        kind, state_space="spatial", observation="range_bearing", new_objects={"sigma_tilt_rad": PINNED**0.5}, **values
    )
    engine = Engine(
        configuration,
        MapPrior(tuple(map(_body, range(len(OBJECTS))))),
        initial_pose=pose_vector_from_planar(START),
        initial_covariance=full(START_VARIANCES),
    )
    for k, frame in enumerate(frames):
        seen = [
            Detection.along(
                [np.cos(b), np.sin(b), 0.0],
                r,
                sigma_range_m=RANGE_SIGMA,
                ray_covariance=BEARING_SIGMA**2 * np.eye(3),
                track_id=name,
                class_scores=scores,
            )
            for r, b, name, scores in frame
        ]
        motion = {"motion": pose_vector_from_planar(STEP), "motion_covariance": full(STEP_VARIANCES)}
        belief = engine.process(Keyframe.spatial(k, detections=seen, **motion))
    return engine, belief


def full(variances: np.ndarray) -> np.ndarray:
    """(6, 6) over x y z rx ry rz, of which only x, y and yaw are uncertain."""
    covariance = PINNED * np.eye(6)
    covariance[IN_PLANE, IN_PLANE] = variances
    return covariance


def _body(number: int) -> ObjectPrior:
    covariance = full(OBJECT_VARIANCES)
    covariance[3, 3] = covariance[4, 4] = 0.0  # the configuration has them
    return ObjectPrior(
        object_id=number,
        name=f"object_{number}",
        pose=pose_vector_from_planar(OBJECTS[number]),
        covariance=covariance,
        class_probabilities={},
    )

"""Rooms of known furniture, classes unknown, that a lost robot drives through; and what may be wrong with the data."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration, SemanticModelConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import covariance_from_planar, planar_from_pose_vector, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints

CLASSES = (2, 4, 2, 1, 0, 4, 3, 2)
"""Classes of the eight pieces: three crates, two lockers, one of each other kind."""
SIGMA_RANGE_M, SIGMA_BEARING_RAD = 0.1, 0.03
SIGMA_STEP = np.array([0.03, 0.03, 0.015])
SIGMA_MAP = np.array([0.22, 0.22, 0.022])
LOST_M, HEADING_RAD = 10.0, 0.2
REACH_M, HALF_VIEW_RAD = 4.0, 0.7


@dataclass(frozen=True)
class ClosedRoom:
    """A drive with its map prior; D detections of a keyframe."""

    prior: MapPrior
    start: np.ndarray  # (3,) where the robot is said to start
    keyframes: tuple[Keyframe, ...]  # K
    truth: np.ndarray  # (K, 3)
    associations: tuple[tuple[int, ...], ...]  # K: object of each detection
    objects: np.ndarray  # (O, 3)


def make_room(
    seed: int,
    num_keyframes: int = 40,
    objects: np.ndarray | None = None,
    classes: Sequence[int] = CLASSES,
    carried: np.ndarray | None = None,
) -> ClosedRoom:
    """One drive around the furniture; everything is drawn from the models that the engine has.

    ``objects`` (O, 3) of ``classes`` stand in the room in place of those that the seed draws. After the drive the robot
    is ``carried``, of which odometry tells nothing, to the first of the poses (M, 3) that it then drives along.
    """
    random = np.random.default_rng([17, seed])
    drawn = _furniture(random)
    objects = drawn if objects is None else objects
    truth, controls = _drive(random, num_keyframes, np.zeros((0, 3)) if carried is None else carried)
    model = load_model(SemanticModelConfiguration())
    assert model is not None
    keyframes, associations = [], []
    for k, (pose, control) in enumerate(zip(truth, controls, strict=True)):
        seen = _visible(pose, objects)
        keyframes.append(_keyframe(k, control, _measured(random, model, k, pose, objects, seen, classes)))
        associations.append(tuple(seen.tolist()))
    start = truth[0] + random.normal(size=3) * [LOST_M, LOST_M, HEADING_RAD]
    return ClosedRoom(_map(random, objects), start, tuple(keyframes), truth, tuple(associations), objects)


def with_map_known_to(room: ClosedRoom, sigma_m: float) -> ClosedRoom:
    """The drive with a map whose places are off in the same directions, as far as ``sigma_m`` says."""
    scale = sigma_m / SIGMA_MAP[0]
    objects = []
    for item in room.prior.objects:
        x, y, yaw = planar_from_pose_vector(item.pose)
        place = room.objects[item.object_id, :2]
        x, y = place + scale * ([x, y] - place)
        objects.append(ObjectPrior.planar(item.object_id, x, y, yaw, sigma_m=sigma_m, sigma_rad=SIGMA_MAP[2]))
    return replace(room, prior=MapPrior(tuple(objects)))


def without_object(room: ClosedRoom, number: int) -> ClosedRoom:
    """The drive with a map prior that lacks one object."""
    kept = tuple(item for item in room.prior.objects if item.object_id != number)
    return replace(room, prior=MapPrior(kept))


def with_swapped_scores(room: ClosedRoom, views: Sequence[tuple[int, int]], seed: int = 0) -> ClosedRoom:
    """The drive in which each of ``views`` (keyframe, detection) has its largest score swapped with another one."""
    random, keyframes = np.random.default_rng([18, seed]), list(room.keyframes)
    for k, number in views:
        features = keyframes[k].measurements.features.copy()
        own = features[number]
        first = int(own.argmax())
        other = int(random.choice([i for i in range(len(own)) if i != first]))
        own[[first, other]] = own[[other, first]]
        keyframes[k] = replace(keyframes[k], measurements=replace(keyframes[k].measurements, features=features))
    return replace(room, keyframes=tuple(keyframes))


def some_views(room: ClosedRoom, share: float, seed: int = 0) -> list[tuple[int, int]]:
    """A share of all views, drawn at random."""
    random = np.random.default_rng([19, seed])
    every = [(k, i) for k, own in enumerate(room.associations) for i in range(len(own))]
    return [view for view in every if random.random() < share]


def first_view(room: ClosedRoom) -> tuple[int, int]:
    """Keyframe and detection of the first view of the drive."""
    return next((k, 0) for k, own in enumerate(room.associations) if own)


def driven(room: ClosedRoom, **configuration: object) -> list[HybridBelief]:
    """The beliefs after every keyframe, under the default configuration but for some values."""
    return run(room, Configuration.of(**configuration))


def run(room: ClosedRoom, configuration: Configuration) -> list[HybridBelief]:
    """The beliefs after every keyframe."""
    engine = Engine(
        configuration,
        room.prior,
        initial_pose=room.start,
        initial_covariance=np.diag([LOST_M**2, LOST_M**2, HEADING_RAD**2]),
    )
    return [engine.process(keyframe) for keyframe in room.keyframes]


def position_error_m(room: ClosedRoom, belief: HybridBelief) -> float:
    """Distance of the heaviest hypothesis's newest pose from the truth."""
    return float(np.hypot(*(planar_from_pose_vector(belief.poses[0])[:2] - room.truth[belief.keyframe, :2])))


def normalised_error(room: ClosedRoom, belief: HybridBelief) -> float:
    """Squared Mahalanobis distance of the true position from the heaviest hypothesis's, which is 2 on average."""
    off = belief.poses[0, :2] - room.truth[belief.keyframe, :2]
    return float(off @ np.linalg.solve(belief.pose_covariances[0, :2, :2], off))


def _furniture(random: np.random.Generator) -> np.ndarray:
    """(O, 3) about the corners and edges of a square, almost on a grid."""
    grid = [(x, y) for x in (0.0, 3.0, 6.0) for y in (0.0, 3.0, 6.0) if (x, y) != (3.0, 3.0)]
    places = np.array(grid) + random.normal(size=(8, 2)) * 0.15
    return np.column_stack([places, random.uniform(-np.pi, np.pi, 8)])


def _drive(random: np.random.Generator, count: int, carried: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """(K, 3) true poses on a circle inside, looking outwards and ahead, and odometry to each of them."""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    circle = np.column_stack([3.0 + 0.9 * np.cos(angle), 3.0 + 0.9 * np.sin(angle), angle + 0.4])
    truth = np.concatenate([circle, carried])
    before = truth[0]
    controls = []
    for k, pose in enumerate(truth):
        control = se2.between(pose if k == count else before, pose)
        controls.append(se2.compose(control, se2.exp(random.normal(size=3) * SIGMA_STEP)))
        before = pose
    return truth, controls


def _visible(pose: np.ndarray, objects: np.ndarray) -> np.ndarray:
    relative = se2.between(np.broadcast_to(pose, objects.shape), objects)
    distance, bearing = np.hypot(relative[:, 0], relative[:, 1]), np.arctan2(relative[:, 1], relative[:, 0])
    return np.flatnonzero((distance < REACH_M) & (np.abs(bearing) < HALF_VIEW_RAD))


def _measured(
    random: np.random.Generator,
    model: ViewpointModel,
    k: int,
    pose: np.ndarray,
    objects: np.ndarray,
    seen: np.ndarray,
    classes: Sequence[int],
) -> SemanticMeasurements:
    count, size = len(seen), model.num_features
    robot = np.broadcast_to(pose, (count, 3))
    relative, camera = se2.between(robot, objects[seen]), se2.between(objects[seen], robot)
    views = Viewpoints(np.arctan2(camera[:, 1], camera[:, 0]), np.zeros(count), np.hypot(camera[:, 0], camera[:, 1]))
    expected = model.predict(np.array(classes)[seen], views)
    errors = [random.multivariate_normal(np.zeros(size), own) for own in expected.covariance]
    noise = random.normal(size=(count, 2)) * [SIGMA_RANGE_M, SIGMA_BEARING_RAD]
    return SemanticMeasurements(
        stamp_ns=(k + 1) * 10**9,
        sequence=k,
        frame_id="base_link",
        class_names=model.class_names,
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.zeros((count, 4)),
        labels=("object",) * count,
        scores=np.ones(count),
        track_ids=("",) * count,
        class_probability_samples=np.zeros((count, 1, size)),
        features=expected.mean + np.array(errors).reshape(count, size),
        feature_covariances=np.zeros((count, size, size)),
        predictive_entropy=np.zeros(count),
        mutual_information=np.zeros(count),
        ranges_m=np.hypot(relative[:, 0], relative[:, 1]) + noise[:, 0],
        bearings_rad=np.arctan2(relative[:, 1], relative[:, 0]) + noise[:, 1],
        geometric_covariances=np.tile(np.diag([SIGMA_RANGE_M, SIGMA_BEARING_RAD]) ** 2, (count, 1, 1)),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )


def _keyframe(k: int, control: np.ndarray, measurements: SemanticMeasurements) -> Keyframe:
    return Keyframe(
        index=k,
        stamp_ns=measurements.stamp_ns,
        odometry=pose_vector_from_planar(control),
        odometry_covariance=covariance_from_planar(np.diag(SIGMA_STEP**2)),
        measurements=measurements,
    )


def _map(random: np.random.Generator, objects: np.ndarray) -> MapPrior:
    drawn = objects + random.normal(size=objects.shape) * SIGMA_MAP
    return MapPrior(
        tuple(
            ObjectPrior.planar(n, *pose.tolist(), sigma_m=SIGMA_MAP[0], sigma_rad=SIGMA_MAP[2])
            for n, pose in enumerate(drawn)
        )
    )

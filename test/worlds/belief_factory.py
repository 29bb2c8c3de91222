"""A made-up run of a lost robot among aliased objects: truth, lineages and weights are exactly what a script says.

Nothing here infers anything. Hypotheses are the true path seen from wrong places, and their weights follow a
script: six lineages, one of them left from keyframe 13 on.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np

from semantic_slam import configuration
from semantic_slam.bag.writer import BagWriter
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.entropy import association_entropy, component_entropy
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.messages.standard import OdometryEstimate, header_message
from semantic_slam.messages.typestore import message_class
from semantic_slam.perception.measurement import SemanticMeasurements

CLASSES = ("crate", "chest", "desk")
OBJECTS = np.array([[0, 0, 0.3], [3, 4, 1.2], [-3, 4, 2.0], [-4, -2, -1.0], [4, -3, 0.0], [0, 6.5, -1.6], [6, 1, 2.6]])
OBJECT_CLASSES = (0, 0, 1, 1, 2, 0, 2)
OFFSETS = np.array([[0, 0, 0], [3, 4, 1.2], [-3, 4.3, 2.0], [-4, -2, -1.0], [4, -3.5, 0.4], [0.5, 6.5, -1.6]])
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
WIDTH, HEIGHT = 640, 480


def small_belief(
    keyframe: int,
    ids: Sequence[int],
    parents: Sequence[int],
    weights: Sequence[float],
    objects: Sequence[int],
    associations: Sequence[Sequence[int]],
    class_names: tuple[str, ...] = CLASSES,
) -> HybridBelief:
    """A belief with everything but its associations at rest."""
    hypotheses, count, classes = len(ids), len(objects), len(class_names)
    uniform = np.full((count, classes), 1.0 / max(classes, 1))
    return HybridBelief(
        stamp_ns=START + keyframe * SECOND,
        keyframe=keyframe,
        planar=True,
        class_names=class_names,
        num_candidates=hypotheses,
        hypothesis_ids=np.array(ids, dtype=np.uint64),
        parent_ids=np.array(parents, dtype=np.uint64),
        modes=np.zeros(hypotheses, dtype=np.uint16),
        log_weights=np.log(np.array(weights)),
        poses=pose_vector_from_planar(np.zeros((hypotheses, 3))),
        pose_covariances=np.stack([covariance_from_planar(0.01 * np.eye(3))] * hypotheses),
        detection_ids=np.arange(len(associations[0]), dtype=np.uint32),
        associations=np.array(associations, dtype=np.int32),
        object_ids=np.array(objects, dtype=np.uint32),
        object_names=tuple(str(number) for number in objects),
        hypothesis_class_probabilities=np.stack([uniform] * hypotheses),
        existence=np.ones(count),
        class_probabilities=uniform,
        object_poses=pose_vector_from_planar(np.zeros((count, 3))),
        object_covariances=covariance_from_planar(np.tile(0.04 * np.eye(3), (count, 1, 1))),
        mutual_information=np.full(count, np.nan),
        in_coverage=np.ones(count, dtype=bool),
        forgotten_views=np.zeros(count, dtype=np.uint32),
        descriptors=np.zeros((count, 0)),
        descriptor_covariances=np.zeros((count, 0)),
        association_entropy=0.0,
        component_entropy=component_entropy(np.array(weights)),
        discarded_mass=0.0,
        dropped=0,
    )


def true_path(keyframes: int) -> Array:
    """(K, 3) an ellipse driven counter-clockwise."""
    angle = np.linspace(-0.6, 4.9, keyframes)
    x, y = 4.6 * np.cos(angle), 1.5 + 3.6 * np.sin(angle)
    return np.stack([x, y, np.arctan2(3.6 * np.cos(angle), -4.6 * np.sin(angle))], axis=1)


def visible(pose: Array) -> list[int]:
    """The (at most three) nearest objects in front of the robot."""
    to_object = OBJECTS[:, :2] - pose[:2]
    bearing = np.abs((np.arctan2(to_object[:, 1], to_object[:, 0]) - pose[2] + np.pi) % (2 * np.pi) - np.pi)
    ranges = np.linalg.norm(to_object, axis=1)
    return [int(n) for n in np.argsort(ranges) if bearing[n] < 1.2 and ranges[n] < 7.0][:3]


def lineage_weights(k: int) -> Array:
    """(6,) weights of the six lineages: even at first, then the first one wins."""
    drift = np.array([0.0, -0.55, -0.75, -1.2, -0.9, -0.65]) * max(0, k - 4)
    wobble = 0.35 * np.sin(np.arange(6) * 2.1 + k)
    weights = np.exp(drift + wobble - np.max(drift + wobble))
    weights[weights < 1 / 150] = 0.0
    return np.asarray(weights / weights.sum())


def with_noise(belief: HybridBelief, noise: Mapping[str, tuple[float, float]]) -> HybridBelief:
    """The belief with what it tells of the noise: name -> value and standard deviation."""
    values, sigmas = np.array([*noise.values()]).reshape(-1, 2).T
    return dataclasses.replace(belief, noise_names=tuple(noise), noise_values=values, noise_sigmas=sigmas)


def belief_at(k: int, path: Array, class_names: tuple[str, ...], object_names: tuple[str, ...]) -> HybridBelief:
    weights = lineage_weights(k)
    alive = np.flatnonzero(weights)
    seen = visible(path[k])
    associations = [[(n + (h if h < 4 else 2 * h)) % len(OBJECTS) for n in seen] for h in alive]
    base = small_belief(
        k, 100 * (k + 1) + alive, 100 * k + alive, weights[alive], range(1, len(OBJECTS) + 1), associations, class_names
    )
    generator = np.random.default_rng((7, k))
    sigma = 0.05 + 0.5 * np.exp(-k / 3)
    poses = path[k] + OFFSETS[alive] + generator.normal(scale=sigma * 0.4, size=(len(alive), 3)) * [1, 1, 0.3]
    heading = np.diag([1.0, 1.0, 0.09]) + np.array([[0, 0.35, 0], [0.35, 0, 0], [0, 0, 0]])
    probabilities = class_course(k, len(class_names))
    spread = 0.05 + 0.45 * np.exp(-k / 8) * (1 + np.arange(len(OBJECTS)) % 3)
    noise = np.random.default_rng(11).normal(scale=0.5, size=OBJECTS.shape) * spread[:, None]
    return dataclasses.replace(
        base,
        num_candidates=int(40 * len(alive) + 17 * (k % 5)),
        object_names=object_names,
        poses=pose_vector_from_planar(poses),
        pose_covariances=np.stack([covariance_from_planar(sigma**2 * heading)] * len(alive)),
        hypothesis_class_probabilities=np.stack([probabilities] * len(alive)),
        class_probabilities=probabilities,
        object_poses=pose_vector_from_planar(OBJECTS + noise * [1, 1, 0.2]),
        object_covariances=np.stack([covariance_from_planar(s**2 * heading) for s in spread]),
        association_entropy=association_entropy(weights[alive], [tuple(row) for row in associations]),
        discarded_mass=1 - 0.9995**k,
        dropped=k // 20,
    )


def class_course(k: int, classes: int) -> Array:
    """(O, C): all objects become certain, but the last one stays between the first two classes."""
    certainty = 1 - np.exp(-np.maximum(0, k - 2 * np.arange(len(OBJECTS))) / 4)
    rows = np.full((len(OBJECTS), classes), 1.0 / classes)
    for n, true in enumerate(OBJECT_CLASSES):
        target = np.full(classes, 0.004)
        target[true] = 1.0
        if n == len(OBJECTS) - 1:
            target[:3] = [0.42, 0.01, 0.57]
        rows[n] = (1 - certainty[n]) * rows[n] + certainty[n] * target / target.sum()
    return rows


def measurements_at(k: int, seen: list[int], class_names: tuple[str, ...]) -> SemanticMeasurements:
    count = len(seen)
    samples = np.random.default_rng((3, k)).dirichlet(np.full(len(class_names), 2.0), size=(count, 4))
    left = np.array([60.0 + 190 * n for n in range(count)])
    return SemanticMeasurements(
        stamp_ns=START + k * SECOND,
        sequence=k,
        frame_id="base_link",
        class_names=class_names,
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.stack([left, left * 0 + 190, left + 130, left * 0 + 330], axis=1).reshape(-1, 4),
        labels=tuple(class_names[OBJECT_CLASSES[n]] for n in seen),
        scores=np.full(count, 0.9),
        track_ids=("",) * count,
        class_probability_samples=samples,
        features=np.zeros((count, 2)),
        feature_covariances=np.zeros((count, 2, 2)),
        predictive_entropy=np.full(count, 0.5),
        mutual_information=np.full(count, 0.1),
        ranges_m=np.full(count, 2.0),
        bearings_rad=np.zeros(count),
        geometric_covariances=np.stack([np.eye(2) * 0.01] * count) if count else np.zeros((0, 2, 2)),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=bool),
    )


def picture(k: int, seen: list[int]) -> bytes:
    """JPEG of coloured boxes on a floor."""
    image = np.full((HEIGHT, WIDTH, 3), 205, dtype=np.uint8)
    image[300:] = (150, 170, 185)
    for n, number in enumerate(seen):
        left = 60 + 190 * n
        colour = tuple(int(value) for value in np.random.default_rng(number).integers(60, 190, 3))
        cv2.rectangle(image, (left + 8, 196), (left + 122, 324), colour, -1)
    return bytes(cv2.imencode(".jpg", image)[1])


def run_configuration(source: Path, class_names: tuple[str, ...], object_names: tuple[str, ...]) -> RunConfiguration:
    covariance = covariance_from_planar(np.diag([1.0, 1.0, 0.05]))
    prior = MapPrior(
        tuple(
            ObjectPrior(
                object_id=n + 1,
                name=object_names[n],
                pose=pose_vector_from_planar(OBJECTS[n]),
                covariance=covariance,
                class_probabilities={},
            )
            for n in range(len(OBJECTS))
        )
    )
    return RunConfiguration(
        run_id="made-up",
        stamp_ns=START,
        configuration=json.dumps(configuration.to_dict(configuration.Configuration(seed=5))),
        map_prior=prior.to_json(),
        initial_pose=pose_vector_from_planar(true_path(2)[0] + [6.0, -5.0, 0.15]),
        initial_covariance=covariance_from_planar(np.diag([100.0, 100.0, 0.04])),
        class_names=class_names,
        source=json.dumps({"path": str(source), "sha256": "0" * 64}),
        revision="0123abc",
    )


def write_belief_bag(
    folder: Path,
    keyframes: int = 40,
    class_names: tuple[str, ...] = CLASSES,
    object_names: tuple[str, ...] = ("", "", "", "", "", "", ""),
    with_truth: bool = True,
    noise: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> tuple[Path, Path]:
    """A belief bag and the bag with the pictures that it came from: their paths.

    ``noise``: name -> value and standard deviation that every belief tells.
    """
    path = true_path(keyframes)
    source, beliefs = folder / "source", folder / "belief"
    run = run_configuration(source, class_names, object_names)
    rows: list[tuple[str, int, Any]] = [(topics.RUN_CONFIGURATION, START, run)]
    pictures: list[tuple[str, int, Any]] = []
    odometry = odometry_of(path)
    for k in range(keyframes):
        stamp, seen = START + k * SECOND, visible(path[k])
        rows.append((topics.ODOMETRY, stamp, odometry_message(stamp, odometry[k], "odom")))
        rows.append((topics.MEASUREMENTS, stamp, measurements_at(k, seen, class_names)))
        rows.append((topics.BELIEF, stamp, with_noise(belief_at(k, path, class_names, object_names), noise)))
        if with_truth:
            names = tuple(str(n + 1) for n in seen)
            rows.append((topics.GROUND_TRUTH_ASSOCIATIONS, stamp, GroundTruthAssociations(stamp, names)))
            rows.append((topics.GROUND_TRUTH_ODOMETRY, stamp, odometry_message(stamp, path[k], "map")))
        pictures.append((topics.IMAGE_COMPRESSED, stamp, compressed_image(stamp, picture(k, seen))))
    if with_truth:
        true_classes = tuple(class_names[n] for n in OBJECT_CLASSES)
        ids = tuple(str(n + 1) for n in range(len(OBJECTS)))
        truth = GroundTruthObjects(START, ids, true_classes, pose_vector_from_planar(OBJECTS))
        rows.append((topics.GROUND_TRUTH_OBJECTS, START, truth))
    write_rows(beliefs, rows)
    write_rows(source, pictures)
    return beliefs, source


def odometry_of(path: Array) -> Array:
    """(K, 3) what wheels make of ``path``: scaled and bent a little, starting at zero."""
    steps = np.diff(path, axis=0)
    length = np.linalg.norm(steps[:, :2], axis=1) * 1.04
    turns = (steps[:, 2] + np.pi) % (2 * np.pi) - np.pi + 0.012
    yaw = np.concatenate([[0.0], np.cumsum(turns)])
    moves = length[:, None] * np.stack([np.cos(yaw[:-1]), np.sin(yaw[:-1])], axis=1)
    return np.hstack([np.vstack([[0.0, 0.0], np.cumsum(moves, axis=0)]), yaw[:, None]])


def odometry_message(stamp: int, pose: Array, frame: str) -> OdometryEstimate:
    return OdometryEstimate(stamp, frame, "base_link", pose_vector_from_planar(pose), np.zeros((6, 6)))


def compressed_image(stamp: int, data: bytes) -> Any:
    kind = message_class("sensor_msgs/msg/CompressedImage")
    header = header_message(stamp, "camera_optical_frame")
    return kind(header=header, format="jpeg", data=np.frombuffer(data, dtype=np.uint8))


def write_rows(path: Path, rows: list[tuple[str, int, Any]]) -> None:
    """A bag of (topic, stamp, message)."""
    with BagWriter(path) as writer:
        for topic, stamp, message in sorted(rows, key=lambda row: row[1]):
            writer.write(topic, message, stamp)

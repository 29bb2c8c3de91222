"""A small input bag of a robot that drives straight at two boxes: places, odometry, depth and extrinsics are exact.

The messages come as a list that a test may spoil before it is written.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from semantic_slam.bag.writer import BagWriter
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.messages.standard import NANOSECONDS, OdometryEstimate, header_message
from semantic_slam.messages.typestore import message_class
from semantic_slam.perception.frame import Detections

START = 1_700_000_000 * NANOSECONDS
PERIOD = NANOSECONDS // 2
WIDTH, HEIGHT, FOCAL = 160, 120, 100.0
OPTICAL = "camera_optical_frame"
T_BASE_CAMERA = np.array([0.1, 0.0, 0.3, -0.5, 0.5, -0.5, 0.5])
OBJECTS = np.array([[3.0, 0.5, 0.3], [3.5, -0.6, 0.3]])
SPEED_M = 0.1  # per frame, along x


@dataclass
class Entry:
    """One message on its way into a bag."""

    topic: str
    message: Any
    stamp_ns: int


def frame_stamp(k: int) -> int:
    return START + k * PERIOD


def stamps(items: Iterable[Any]) -> list[int]:
    """Nanoseconds of frames, keyframes or messages."""
    return [item.stamp_ns for item in items]


def input_entries(num_frames: int = 6, with_depth: bool = True) -> list[Entry]:
    """The whole bag in the order of its stamps."""
    entries = [
        Entry(topics.TF_STATIC, static_transform(START, OPTICAL, T_BASE_CAMERA), START),
        Entry(topics.GROUND_TRUTH_OBJECTS, _true_objects(), START),
    ]
    entries.append(Entry(topics.ODOMETRY, to_message(odometry(START - PERIOD, -SPEED_M)), START - PERIOD))
    for k in range(num_frames):
        stamp, x = frame_stamp(k), SPEED_M * k
        boxes, depths = _views(x)
        entries += [
            Entry(topics.ODOMETRY, to_message(odometry(stamp, x)), stamp),
            Entry(topics.GROUND_TRUTH_ODOMETRY, to_message(odometry(stamp, x, "map")), stamp),
            Entry(topics.CAMERA_INFO, camera_info(stamp), stamp),
            Entry(topics.IMAGE_COMPRESSED, image(stamp, boxes), stamp),
            Entry(topics.DETECTIONS, to_message(detections(stamp, boxes)), stamp),
            Entry(topics.GROUND_TRUTH_ASSOCIATIONS, to_message(GroundTruthAssociations(stamp, ("1", "2"))), stamp),
        ]
        if with_depth:
            entries.append(Entry(topics.DEPTH_COMPRESSED, depth(stamp, boxes, depths), stamp))
    return entries


def of_topic(entries: list[Entry], topic: str) -> list[Entry]:
    return [entry for entry in entries if entry.topic == topic]


def without(entries: list[Entry], topic: str) -> list[Entry]:
    return [entry for entry in entries if entry.topic != topic]


def write_bag(path: Path, entries: list[Entry]) -> Path:
    """The bag, with the map prior beside it."""
    with BagWriter(path) as writer:
        for entry in entries:
            writer.write(entry.topic, entry.message, entry.stamp_ns)
    (path / "objects.json").write_text(map_prior().to_json())
    return path


def map_prior() -> MapPrior:
    covariance = np.diag([0.01, 0.01, 1e-6, 1e-6, 1e-6, 0.01])
    poses = [np.array([*position, 0.0, 0.0, 0.0, 1.0]) for position in OBJECTS]
    return MapPrior(
        tuple(
            ObjectPrior(object_id=n + 1, name=f"box {n + 1}", pose=pose, covariance=covariance, class_probabilities={})
            for n, pose in enumerate(poses)
        )
    )


def write_configuration(folder: Path, **changes: Any) -> Path:
    """A quick configuration: an untrained network, five passes, no semantics (JSON is YAML)."""
    folder.mkdir(parents=True, exist_ok=True)
    values: dict[str, Any] = {
        "semantic_model": {"kind": "none"},
        "perception": {
            "network": str(untrained_network(folder / "network.safetensors")),
            "num_passes": 5,
            "depth_to_width": 0.0,
        },
    }
    for section, value in changes.items():
        values[section] = {**values.get(section, {}), **value} if isinstance(value, dict) else value
    path = folder / "configuration.yaml"
    path.write_text(json.dumps(values))
    return path


def untrained_network(path: Path) -> Path:
    path.write_bytes(_untrained_weights())
    return path


@cache
def _untrained_weights() -> bytes:
    """Content of the file, drawn once: its initialisation takes longer than many a run with it."""
    import torch

    from semantic_slam.perception.networks.compact_network import CompactNetwork
    from semantic_slam.perception.networks.weights import save_compact_network

    torch.manual_seed(0)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "network.safetensors"
        save_compact_network(CompactNetwork(2), ("crate", "chest"), {}, path)
        return path.read_bytes()


def odometry(stamp: int, x: float, frame: str = "odom") -> OdometryEstimate:
    return OdometryEstimate(stamp, frame, "base_link", np.array([x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.zeros((6, 6)))


def detections(stamp: int, boxes: np.ndarray) -> Detections:
    return Detections(
        stamp_ns=stamp,
        frame_id=OPTICAL,
        boxes=boxes,
        labels=("box",) * len(boxes),
        scores=np.full(len(boxes), 0.9),
        track_ids=("",) * len(boxes),
    )


def camera_info(stamp: int) -> Any:
    return message_class("sensor_msgs/msg/CameraInfo")(
        header=header_message(stamp, OPTICAL),
        height=HEIGHT,
        width=WIDTH,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([FOCAL, 0, WIDTH / 2, 0, FOCAL, HEIGHT / 2, 0, 0, 1], dtype=np.float64),
        r=np.eye(3).ravel(),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=message_class("sensor_msgs/msg/RegionOfInterest")(
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def image(stamp: int, boxes: np.ndarray) -> Any:
    pixels = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    for n, (x_min, y_min, x_max, y_max) in enumerate(boxes.round().astype(int)):
        pixels[y_min:y_max, x_min:x_max] = (40 + 150 * n, 60, 200 - 150 * n)
    return compressed(stamp, "jpeg", cv2.imencode(".jpg", pixels)[1])


def depth(stamp: int, boxes: np.ndarray, depths_m: np.ndarray) -> Any:
    millimetres = np.zeros((HEIGHT, WIDTH), np.uint16)
    for (x_min, y_min, x_max, y_max), value in zip(boxes.round().astype(int), depths_m, strict=True):
        millimetres[y_min:y_max, x_min:x_max] = round(1000 * value)
    return compressed(stamp, "16UC1; png compressed", cv2.imencode(".png", millimetres)[1])


def compressed(stamp: int, text: str, data: np.ndarray) -> Any:
    message = message_class("sensor_msgs/msg/CompressedImage")
    return message(header=header_message(stamp, OPTICAL), format=text, data=data)


def _views(x: float) -> tuple[np.ndarray, np.ndarray]:
    """(2, 4) boxes and (2,) depths of the two objects, seen from base_link at ``x``, looking along x of map."""
    forward, left, up = (OBJECTS - [x + T_BASE_CAMERA[0], T_BASE_CAMERA[1], T_BASE_CAMERA[2]]).T
    u, v = WIDTH / 2 - FOCAL * left / forward, HEIGHT / 2 - FOCAL * up / forward
    half = 0.5 * FOCAL * 0.4 / forward
    return np.stack([u - half, v - half, u + half, v + half], axis=1), forward


def _true_objects() -> Any:
    poses = np.hstack([OBJECTS, np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))])
    return to_message(GroundTruthObjects(START, ("1", "2"), ("crate", "chest"), poses))


def static_transform(stamp: int, frame: str, T_base_frame: np.ndarray) -> Any:
    x, y, z, qx, qy, qz, qw = (float(value) for value in T_base_frame)
    transform = message_class("geometry_msgs/msg/Transform")(
        translation=message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z),
        rotation=message_class("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw),
    )
    stamped = message_class("geometry_msgs/msg/TransformStamped")(
        header=header_message(stamp, "base_link"), child_frame_id=frame, transform=transform
    )
    return message_class("tf2_msgs/msg/TFMessage")(transforms=[stamped])


def noisy(entries: list[Entry]) -> list[Entry]:
    """The same with images that do not compress, as real ones: about 25 kB each."""
    chance = np.random.default_rng(0)
    for entry in of_topic(entries, topics.IMAGE_COMPRESSED):
        pixels = chance.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        entry.message.data = cv2.imencode(".jpg", pixels)[1]
    return entries

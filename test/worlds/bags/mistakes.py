"""Mistakes that people make, planted into the messages of the small bag before it is written."""

import json
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from worlds.bags.bag_factory import Entry, map_prior, of_topic
from worlds.bags.places import relative_positions
from worlds.bags.raw_image import raw_image

from semantic_slam.inference.world.map_prior import MapPrior, parse_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.standard import NANOSECONDS, stamp_ns, time_message
from semantic_slam.messages.typestore import message_class

Entries = list[Entry]


def each(topic: str, change: Callable[[Any], None]) -> Callable[[Entries], Entries]:
    """Change every message of a topic."""

    def plant(entries: Entries) -> Entries:
        for entry in of_topic(entries, topic):
            change(entry.message)
        return entries

    return plant


def shift(seconds: float) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        message.header.stamp = time_message(stamp_ns(message.header.stamp) + round(seconds * NANOSECONDS))

    return change


def retyped(entries: Entries) -> Entries:
    """Odometry as bare poses."""
    for entry in of_topic(entries, topics.ODOMETRY):
        pose = entry.message.pose
        entry.message = message_class("geometry_msgs/msg/PoseWithCovarianceStamped")(
            header=entry.message.header, pose=pose
        )
    return entries


def raw_depth(scale: float, encoding: str) -> Callable[[Entries], Entries]:
    """Metres by ``scale``, as a driver publishes them."""

    def plant(entries: Entries) -> Entries:
        for entry in of_topic(entries, topics.DEPTH_COMPRESSED):
            millimetres = cv2.imdecode(np.asarray(entry.message.data), cv2.IMREAD_UNCHANGED)
            pixels = (millimetres * (scale / 1000.0)).astype(np.float32 if encoding == "32FC1" else np.uint16)
            entry.topic = topics.DEPTH
            entry.message = raw_image(entry.message.header, pixels, encoding)
        return entries

    return plant


def rotated(*quaternion: float) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        rotation = message.transforms[0].transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = quaternion

    return change


def scaled_boxes(x: float, y: float) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        message.boxes = message.boxes * np.tile([x, y, x, y], len(message.labels))

    return change


def doubled(message: Any) -> None:
    """Every box again, moved by a tenth of its width."""
    boxes = np.asarray(message.boxes).reshape(-1, 4)
    moved = boxes + 0.1 * (boxes[:, 2:3] - boxes[:, :1]) * np.array([1.0, 0.0, 1.0, 0.0])
    message.boxes = np.concatenate([boxes, moved]).ravel()
    message.scores = np.tile(message.scores, 2)
    message.labels, message.track_ids = list(message.labels) * 2, list(message.track_ids) * 2


def other_labels(message: Any) -> None:
    message.labels = ["teapot"] * len(message.labels)


def varied(message: Any) -> None:
    message.scores = 0.5 + 0.4 * np.sin(np.arange(len(message.labels)) + stamp_ns(message.header.stamp) / 1e9)


def of_lidar(message: Any) -> None:
    message.header.frame_id = "lidar"


def beside_positions(entries: Entries) -> Entries:
    """Boxes without pictures, each with the position of its object in the body frame."""
    for number, entry in enumerate(of_topic(entries, topics.DETECTIONS)):
        entry.message.positions = relative_positions(number).ravel()
    return [each for each in entries if each.topic not in (topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED)]


def emptied(message: Any) -> None:
    message.labels, message.track_ids = [], []
    message.boxes, message.scores = np.zeros(0), np.zeros(0)


def scored(value: float) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        message.scores = np.full(len(message.labels), value)

    return change


def swapped(message: Any) -> None:
    message.header.frame_id, message.child_frame_id = message.child_frame_id, message.header.frame_id


def one_ahead(entries: Entries) -> Entries:
    shift(1e6)(of_topic(entries, topics.ODOMETRY)[12].message)
    return entries


def set_back(entries: Entries) -> Entries:
    """Odometry and its publisher began anew in the middle."""
    for entry in of_topic(entries, topics.ODOMETRY)[12:]:
        shift(-1000.0)(entry.message)
    return entries


def jumped(entries: Entries) -> Entries:
    """Odometry goes on from another place: 40 m away, as its samples here are 0.5 s apart."""
    for entry in of_topic(entries, topics.ODOMETRY)[12:]:
        entry.message.pose.pose.position.y += 40.0
    return entries


def sparse(entries: Entries) -> Entries:
    """Every fourth odometry sample, of 0.4 m each."""
    dropped = [entry for n, entry in enumerate(of_topic(entries, topics.ODOMETRY)) if n % 4]
    return [entry for entry in entries if not any(entry is other for other in dropped)]


def every_other(topic: str) -> Callable[[Entries], Entries]:
    """Leave out every second message of a topic."""

    def plant(entries: Entries) -> Entries:
        dropped = of_topic(entries, topic)[1::2]
        return [entry for entry in entries if not any(entry is other for other in dropped)]

    return plant


def renamed(entries: Entries) -> Entries:
    for entry in of_topic(entries, topics.ODOMETRY):
        entry.topic = "wheel_odometry"
    return entries


def on_tf(entries: Entries) -> Entries:
    """Odometry comes by /tf alone; what it tells does not matter."""
    (fixed, *_) = of_topic(entries, topics.TF_STATIC)
    for entry in of_topic(entries, topics.ODOMETRY):
        entry.topic, entry.message = topics.TF, fixed.message
    return entries


def silent(entries: Entries) -> Entries:
    """Odometry stops after a third of the drive."""
    stopped = of_topic(entries, topics.ODOMETRY)[8:]
    return [entry for entry in entries if not any(entry is other for other in stopped)]


def of_another_model() -> MapPrior:
    prior = map_prior()
    rows = json.loads(prior.to_json())
    rows["objects"][0]["class_probabilities"] = {"fridge": 1.0}
    return parse_map_prior(json.dumps(rows), "map")

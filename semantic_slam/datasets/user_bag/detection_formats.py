"""Detection messages of other packages as :class:`Detections`.

Their definitions come with the bag, so neither package need be installed, and several generations of the same
message are met in the wild: a layout is recognised by its fields, not by a version.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from semantic_slam.datasets.user_bag import feature_images
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.sensor import plain_frame
from semantic_slam.messages.standard import stamp_ns
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.places import in_body_frame

SCORE_UNKNOWN = 1.0
"""Confidence of a box that comes without any: its detector reported it, and nothing speaks against it."""


def axis_aligned_box(center: Any, width: float, height: float) -> list[float]:
    """x_min y_min x_max y_max around a box given by its centre, turned by ``center.theta`` [rad] when it has one."""
    point = getattr(center, "position", center)
    cos, sin = abs(np.cos(center.theta)), abs(np.sin(center.theta))
    half_x = (width * cos + height * sin) / 2.0
    half_y = (width * sin + height * cos) / 2.0
    return [point.x - half_x, point.y - half_y, point.x + half_x, point.y + half_y]


def from_vision_msgs(message: Any) -> Detections:
    """vision_msgs/Detection2DArray: 4.x, 3.x (no ``center.position``) and 2.x (flat results)."""
    rows = message.detections
    best = [_best_result(row.results) for row in rows]
    found = _detections(
        message.header,
        [axis_aligned_box(row.bbox.center, row.bbox.size_x, row.bbox.size_y) for row in rows],
        [label for label, _ in best],
        [score for _, score in best],
        [_vision_track_id(row) for row in rows],
    )
    return _with_scores(found, [_all_results(row.results) for row in rows])


def _with_scores(found: Detections, told: list[dict[str, float]]) -> Detections:
    """With the scores of all classes that each detection reports, of those that some detection does."""
    names = tuple(sorted({name for scores in told for name in scores}))
    rows = [[scores.get(name, np.nan) for name in names] for scores in told]
    return replace(
        found, class_names=names, class_scores=np.array(rows, dtype=np.float64).reshape(len(told), len(names))
    )


def _all_results(results: Any) -> dict[str, float]:
    """Score of every class that is reported, the best where one is reported twice."""
    scores: dict[str, float] = {}
    for result in sorted(results, key=_score):
        hypothesis = getattr(result, "hypothesis", result)
        scores[_class_of(hypothesis)] = float(hypothesis.score)
    return scores


def _class_of(hypothesis: Any) -> str:
    """``class_id``, or ``id`` of 2.x."""
    return str(hypothesis.class_id if hasattr(hypothesis, "class_id") else hypothesis.id)


def _best_result(results: Any) -> tuple[str, float]:
    """Label and score of the likeliest class; 2.x has ``id`` in the result, later ones ``hypothesis.class_id``."""
    hypotheses = [getattr(result, "hypothesis", result) for result in results]
    if not hypotheses:
        return "", SCORE_UNKNOWN
    best = max(hypotheses, key=lambda hypothesis: float(hypothesis.score))
    return _class_of(best), float(best.score)


def _vision_track_id(row: Any) -> str:
    """``id`` since 4.0; before, ``tracking_id`` counts only where ``is_tracking``."""
    if hasattr(row, "id"):
        return str(row.id)
    return str(row.tracking_id) if getattr(row, "is_tracking", False) else ""


def from_yolo_msgs(message: Any) -> Detections:
    """yolo_msgs/DetectionArray of yolo_ros; its box has ``center.position``, ``center.theta``, ``size``."""
    rows = message.detections
    return _detections(
        message.header,
        [axis_aligned_box(row.bbox.center, row.bbox.size.x, row.bbox.size.y) for row in rows],
        [str(row.class_name) or str(row.class_id) for row in rows],
        [float(row.score) for row in rows],
        [str(row.id) for row in rows],
    )


def from_vision_msgs_3d(message: Any) -> Detections:
    """vision_msgs/Detection3DArray: centres of boxes, in the frame of the header (see :func:`in_body`).

    The covariance is that of the likeliest result's pose, which counts as not told where it is zero.
    """
    rows = message.detections
    best = [_best_result(row.results) for row in rows]
    centres = [row.bbox.center.position for row in rows]
    found = _detections(
        message.header,
        [[np.nan] * 4 for _ in rows],
        [label for label, _ in best],
        [score for _, score in best],
        [_vision_track_id(row) for row in rows],
    )
    return replace(
        _with_scores(found, [_all_results(row.results) for row in rows]),
        positions=np.array([[point.x, point.y, point.z] for point in centres], dtype=np.float64).reshape(-1, 3),
        position_covariances=np.array([_position_covariance(row.results) for row in rows]).reshape(-1, 3, 3),
    )


def _position_covariance(results: Any) -> Array:
    """(3, 3) of the likeliest result, NaN where nothing is told."""
    if not len(results):
        return np.full((3, 3), np.nan)
    best = max(results, key=_score)
    block = np.array(best.pose.covariance, dtype=np.float64).reshape(6, 6)[:3, :3]
    return block if block.any() else np.full((3, 3), np.nan)


def _score(result: Any) -> float:
    return float(getattr(result, "hypothesis", result).score)


def in_body(detections: Detections, type_name: str, base_frame: str, sensor_pose: Callable[[str], Array]) -> Detections:
    """Detections of a message type whose positions are in the sensor's frame, moved to the body; others as they are.

    ``sensor_pose`` gives the (7,) pose of a frame in the body, or raises InputError.
    """
    if type_name not in IN_THE_SENSOR or plain_frame(detections.frame_id) == plain_frame(base_frame):
        return detections
    return in_body_frame(detections, sensor_pose(detections.frame_id), base_frame)


def _detections(
    header: Any, boxes: list[list[float]], labels: list[str], scores: list[float], track_ids: list[str]
) -> Detections:
    return Detections(
        stamp_ns=stamp_ns(header.stamp),
        frame_id=str(header.frame_id),
        boxes=np.array(boxes, dtype=np.float64).reshape(-1, 4),
        labels=tuple(labels),
        scores=np.array(scores, dtype=np.float64),
        track_ids=tuple(track_ids),
    )


READERS: dict[str, Callable[[Any], Detections]] = {
    "semantic_slam_msgs/msg/DetectionArray": from_message,
    "vision_msgs/msg/Detection2DArray": from_vision_msgs,
    "vision_msgs/msg/Detection3DArray": from_vision_msgs_3d,
    "yolo_msgs/msg/DetectionArray": from_yolo_msgs,
    "yolov8_msgs/msg/DetectionArray": from_yolo_msgs,
    feature_images.TYPE: feature_images.from_feature_image,
}
"""Detection types that can be read, by type name."""
IN_THE_SENSOR = frozenset({"vision_msgs/msg/Detection3DArray"})
"""Types whose positions are in the frame of their header; our own are in the body frame."""

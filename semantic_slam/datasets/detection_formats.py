"""Detection messages of other packages as :class:`Detections`.

Their definitions come with the bag, so neither package need be installed, and several generations of the same
message are met in the wild: a layout is recognised by its fields, not by a version.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from semantic_slam.messages.codec import from_message
from semantic_slam.messages.standard import stamp_ns
from semantic_slam.perception.frame import Detections

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
    return _detections(
        message.header,
        [axis_aligned_box(row.bbox.center, row.bbox.size_x, row.bbox.size_y) for row in rows],
        [label for label, _ in best],
        [score for _, score in best],
        [_vision_track_id(row) for row in rows],
    )


def _best_result(results: Any) -> tuple[str, float]:
    """Label and score of the likeliest class; 2.x has ``id`` in the result, later ones ``hypothesis.class_id``."""
    hypotheses = [getattr(result, "hypothesis", result) for result in results]
    if not hypotheses:
        return "", SCORE_UNKNOWN
    best = max(hypotheses, key=lambda hypothesis: float(hypothesis.score))
    return str(best.class_id if hasattr(best, "class_id") else best.id), float(best.score)


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
    "yolo_msgs/msg/DetectionArray": from_yolo_msgs,
    "yolov8_msgs/msg/DetectionArray": from_yolo_msgs,
}
"""Detection types that can be read, by type name."""

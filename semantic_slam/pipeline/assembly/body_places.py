"""The frame of places: where detections have no boxes it is that of their header, and is moved to the body frame."""

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Flags
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import TransformTree, plain_frame
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.places import in_body_frame
from semantic_slam.reasons import LONGEST_NAME, quoted

ELSEWHERE = f"{topics.DETECTIONS}: places of frame "
"""Beginning of the reason for which detections are dropped whose places cannot be moved to the body frame."""


def have_places(detections: Detections) -> Flags:
    """(D,) whether each detection states at least its direction."""
    return np.asarray(np.isfinite(detections.positions[:, :2]).all(axis=1) | np.isfinite(detections.bearings_rad))


def have_boxes(detections: Detections) -> Flags:
    """(D,) whether each detection has a box."""
    return np.asarray(np.isfinite(detections.boxes).all(axis=1))


def with_places_in_body(detections: Detections, base_frame: str, transforms: TransformTree) -> Detections:
    """The detections with their places in the body frame. Raises InputError where these cannot be moved there.

    Without a frame id, and beside boxes, whose camera the frame id names, places are in the body frame already. Ranges
    and bearings are never moved, as bearings alone have no place, and all of a frame have one origin; nor is what has
    no z.
    """
    frame, base = plain_frame(detections.frame_id), plain_frame(base_frame)
    if frame in ("", base) or have_boxes(detections).any() or not have_places(detections).any():
        return detections
    if np.isfinite(detections.bearings_rad).any() or (have_places(detections) & ~_have_points(detections)).any():
        raise InputError(
            f"{ELSEWHERE}{quoted(frame)} by range and bearing or without z, where perception.base_frame is"
            f" {quoted(base)}; state these from the body, or positions x y z, or set perception.base_frame if this is"
            " the body"
        )
    if not transforms.connects(base, frame):
        raise InputError(
            f"{ELSEWHERE}{quoted(frame)}, to which no static transforms lead from {base[:LONGEST_NAME]}; publish"
            f" /tf_static, set perception.base_frame if this is the body, or import with --base-frame"
            f" {base[:LONGEST_NAME]}"
        )
    return in_body_frame(detections, transforms.lookup(base, frame), base_frame)


def _have_points(detections: Detections) -> Flags:
    """(D,) whether each detection states x, y and z."""
    return np.asarray(np.isfinite(detections.positions).all(axis=1))

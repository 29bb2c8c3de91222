"""Standard messages derived from a hybrid belief, for subscribers that ignore hypotheses; all in the map frame."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.belief_views import ObjectPlace
from semantic_slam.messages.standard import MAP_FRAME, PoseEstimate, header_message, pose_message
from semantic_slam.messages.typestore import message_class

NEWEST = 1000
"""Poses of a path that is published or recorded again and again, so that it stays small."""
SPHERE, TEXT, ADD, DELETE = 2, 9, 0, 2
OPACITY, LEAST_SHARE = 0.7, 0.1
SIGMAS = 2.0
LEAST_DIAMETER_M = 0.1
TEXT_HEIGHT_M = 0.25
PALETTE = (
    (0.90, 0.62, 0.0),
    (0.34, 0.71, 0.91),
    (0.0, 0.62, 0.45),
    (0.80, 0.47, 0.65),
    (0.84, 0.37, 0.0),
    (0.0, 0.45, 0.70),
)
"""RGB colours by class index: the colour-blind-safe palette of Okabe and Ito."""
UNKNOWN_COLOUR = (0.6, 0.6, 0.6)


def pose_view(belief: HybridBelief, frame: str = MAP_FRAME) -> PoseEstimate:
    """Pose estimate with the mean and covariance of the whole mixture (moment matching)."""
    pose, covariance = matched_moments(np.exp(belief.log_weights), belief.poses, belief.pose_covariances)
    return PoseEstimate(belief.stamp_ns, frame, pose, covariance)


def path_view(stamps_ns: Sequence[int], poses: Array, frame: str = MAP_FRAME) -> Any:
    """nav_msgs/Path of (K, 7) poses."""
    stamped = message_class("geometry_msgs/msg/PoseStamped")
    known = [
        stamped(header=header_message(stamp_ns, frame), pose=pose_message(pose))
        for stamp_ns, pose in zip(stamps_ns, poses, strict=True)
    ]
    return message_class("nav_msgs/msg/Path")(header=header_message(stamps_ns[-1], frame), poses=known)


class MarkersView:
    """Makes a visualization_msgs/MarkerArray: per object a 2-sigma ellipsoid and a text with its likeliest class.

    An object that is in one of several places has an ellipsoid in each of them. Opacities follow the probabilities that
    it exists, and is there; markers are deleted once it is no longer in the belief.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_shown",)

    def __init__(self, frame: str = MAP_FRAME) -> None:
        self._frame = frame
        self._shown: dict[tuple[str, int], None] = {}

    def of(self, belief: HybridBelief) -> Any:
        """Markers of a belief, and deletions of earlier markers whose objects are gone."""
        markers = []
        for row in range(len(belief.object_ids)):
            pose, covariance = belief.object_poses[row], belief.object_covariances[row]
            if np.isfinite(pose).all() and np.isfinite(covariance).all():
                places = belief.places_of(row)
                markers += [_ellipsoid(belief, row, place, number) for number, place in enumerate(places)]
                markers.append(_label(belief, row, places[0].position))
        shown = {(marker.ns, marker.id): None for marker in markers}
        markers += [_deletion(belief, *gone) for gone in self._shown if gone not in shown]
        self._shown = shown
        for marker in markers:
            marker.header.frame_id = self._frame
        return message_class("visualization_msgs/msg/MarkerArray")(markers=markers)


def transform_view(stamp_ns: int, transforms: Sequence[tuple[str, str, Array]]) -> Any:
    """tf2_msgs/TFMessage of transforms at one stamp: parent, child and (7,) pose of the child in the parent."""
    return message_class("tf2_msgs/msg/TFMessage")(transforms=[_transform(stamp_ns, *own) for own in transforms])


def _transform(stamp_ns: int, parent: str, child: str, pose: Array) -> Any:
    x, y, z, qx, qy, qz, qw = pose.tolist()
    transform = message_class("geometry_msgs/msg/Transform")(
        translation=message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z),
        rotation=message_class("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw),
    )
    stamped = message_class("geometry_msgs/msg/TransformStamped")
    return stamped(header=header_message(stamp_ns, parent), child_frame_id=child, transform=transform)


def likeliest_class(belief: HybridBelief, row: int) -> tuple[int, str]:
    """Index and text, such as ``chair 0.97``, of an object's likeliest class; -1 and its name without classes."""
    name = belief.object_names[row] if row < len(belief.object_names) else str(belief.object_ids[row])
    if not belief.class_names:
        return -1, name
    best = int(np.argmax(belief.class_probabilities[row]))
    return best, f"{belief.class_names[best]} {belief.class_probabilities[row, best]:.2f}"


def _ellipsoid(belief: HybridBelief, row: int, place: ObjectPlace, number: int) -> Any:
    """Marker of an object in its ``number``-th place, from 0, which is a namespace for further ones."""
    variances, axes = np.linalg.eigh(place.covariance)
    axes[:, 0] *= np.sign(np.linalg.det(axes))  # make it a rotation, not a reflection
    namespace = f"place_{number + 1}" if number else "objects"
    marker = _marker(belief, namespace, int(belief.object_ids[row]), SPHERE, likeliest_class(belief, row)[0])
    marker.color.a = _opacity(belief, row) * place.probability
    marker.pose = pose_message(np.concatenate([place.position, _quaternion(axes)]))
    x, y, z = np.maximum(2.0 * SIGMAS * np.sqrt(np.maximum(variances, 0.0)), LEAST_DIAMETER_M).tolist()
    marker.scale = message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)
    return marker


def _deletion(belief: HybridBelief, namespace: str, number: int) -> Any:
    marker = _marker(belief, namespace, number, SPHERE, -1)
    marker.action = DELETE
    return marker


def _opacity(belief: HybridBelief, row: int) -> float:
    """Opacity of an object: 0.7 times its existence probability, which counts as 0.1 at least."""
    existence = float(belief.existence[row])
    return OPACITY * max(existence, LEAST_SHARE) if np.isfinite(existence) else OPACITY


def _label(belief: HybridBelief, row: int, position: Array) -> Any:
    best, text = likeliest_class(belief, row)
    marker = _marker(belief, "classes", int(belief.object_ids[row]), TEXT, best)
    marker.color.a = _opacity(belief, row)
    above = position + np.array([0.0, 0.0, 2.0 * TEXT_HEIGHT_M])
    marker.pose = pose_message(np.concatenate([above, [0.0, 0.0, 0.0, 1.0]]))
    marker.scale = message_class("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=TEXT_HEIGHT_M)
    marker.text = text
    return marker


def _marker(belief: HybridBelief, namespace: str, number: int, kind: int, best: int) -> Any:
    red, green, blue = PALETTE[best % len(PALETTE)] if best >= 0 else UNKNOWN_COLOUR
    vector = message_class("geometry_msgs/msg/Vector3")
    duration = message_class("builtin_interfaces/msg/Duration")(sec=0, nanosec=0)
    empty_image = message_class("sensor_msgs/msg/CompressedImage")(
        header=header_message(0, ""), format="", data=np.zeros(0, np.uint8)
    )
    return message_class("visualization_msgs/msg/Marker")(
        header=header_message(belief.stamp_ns, MAP_FRAME),
        ns=namespace,
        id=number,
        type=kind,
        action=ADD,
        pose=pose_message(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])),
        scale=vector(x=1.0, y=1.0, z=1.0),
        color=message_class("std_msgs/msg/ColorRGBA")(r=red, g=green, b=blue, a=OPACITY),
        lifetime=duration,
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=empty_image,
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=message_class("visualization_msgs/msg/MeshFile")(filename="", data=np.zeros(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )


def _quaternion(axes: Array) -> Array:
    return np.asarray(Rotation.from_matrix(axes).as_quat())

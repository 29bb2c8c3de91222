"""The map as vision_msgs/Detection3DArray, for subscribers that do not know ``HybridBelief``."""

from collections.abc import Callable
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.standard import MAP_FRAME, NANOSECONDS

NO_CLASS = "object"
"""Class name of every object if the run has no classes."""


class DetectionsView:
    """Makes messages of ``vision_msgs`` (4.x); ``make`` returns the message class of a type name."""

    def __init__(self, make: Callable[[str], Any], frame: str = MAP_FRAME) -> None:
        self._make, self._frame = make, frame

    def objects(self, belief: HybridBelief) -> Any:
        """vision_msgs/Detection3DArray of all objects with a finite pose.

        ``id`` is the object's id in the belief, the same in every message of a run. Each class is one result:
        ``class_id`` is its name, ``score`` the probability that the object exists and is of that class. All results
        have the same pose: mean and covariance of the mixture over the hypotheses. The box size is 0, since it is not
        estimated.
        """
        header = self._header(belief.stamp_ns)
        rows = np.flatnonzero(np.isfinite(belief.object_poses).all(axis=1)).tolist()
        detections = [self._detection(belief, row, header) for row in rows]
        return self._make("vision_msgs/msg/Detection3DArray")(header=header, detections=detections)

    def label_info(self, belief: HybridBelief) -> Any:
        """vision_msgs/LabelInfo with the class names, numbered as in the belief."""
        entry = self._make("vision_msgs/msg/VisionClass")
        class_map = [entry(class_id=n, class_name=name) for n, name in enumerate(_classes(belief))]
        header = self._header(belief.stamp_ns)
        return self._make("vision_msgs/msg/LabelInfo")(header=header, class_map=class_map, threshold=0.0)

    def _detection(self, belief: HybridBelief, row: int, header: Any) -> Any:
        existence = float(belief.existence[row])
        shares = belief.class_probabilities[row] if belief.class_names else np.ones(1)
        scores = shares * (existence if np.isfinite(existence) else 1.0)
        pose = self._pose(belief.object_poses[row])
        placed = self._make("geometry_msgs/msg/PoseWithCovariance")(
            pose=pose, covariance=np.ascontiguousarray(belief.object_covariances[row].reshape(36))
        )
        named = self._make("vision_msgs/msg/ObjectHypothesis")
        result = self._make("vision_msgs/msg/ObjectHypothesisWithPose")
        size = self._make("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=0.0)
        return self._make("vision_msgs/msg/Detection3D")(
            header=header,
            results=[
                result(hypothesis=named(class_id=name, score=score), pose=placed)
                for name, score in zip(_classes(belief), scores.tolist(), strict=True)
            ],
            bbox=self._make("vision_msgs/msg/BoundingBox3D")(center=pose, size=size),
            id=str(int(belief.object_ids[row])),
        )

    def _header(self, stamp_ns: int) -> Any:
        seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
        stamp = self._make("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)
        return self._make("std_msgs/msg/Header")(stamp=stamp, frame_id=self._frame)

    def _pose(self, pose: Array) -> Any:
        x, y, z, qx, qy, qz, qw = pose.tolist()
        return self._make("geometry_msgs/msg/Pose")(
            position=self._make("geometry_msgs/msg/Point")(x=x, y=y, z=z),
            orientation=self._make("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw),
        )


def _classes(belief: HybridBelief) -> tuple[str, ...]:
    return tuple(belief.class_names) or (NO_CLASS,)

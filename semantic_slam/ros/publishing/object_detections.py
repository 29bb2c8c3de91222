"""Publishes the map on topics ``~/objects`` and ``~/label_info``, for which package vision_msgs must be installed."""

from rclpy.node import Node
from rclpy.serialization import serialize_message

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.topics import LABEL_INFO, OBJECTS_3D, VISION_TYPES
from semantic_slam.ros.publishing.detections_view import DetectionsView
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, private_name, ros_type


class ObjectDetections:
    """Publishes the objects of every belief, and the classes of the run with its first one."""

    def __init__(self, node: Node, frame: str) -> None:
        self._view = DetectionsView(ros_type, frame)
        self._objects = Outlet(node, private_name(OBJECTS_3D), VISION_TYPES[OBJECTS_3D], qos.latched())
        self._labels = Outlet(node, private_name(LABEL_INFO), VISION_TYPES[LABEL_INFO], qos.latched())
        self._known: tuple[str, ...] | None = None

    def publish(self, belief: HybridBelief) -> None:
        """Publish the objects, preceded by the classes if they have changed."""
        if belief.class_names != self._known:
            self._known = belief.class_names
            self._labels.send(serialize_message(self._view.label_info(belief)))
        self._objects.send(serialize_message(self._view.objects(belief)))

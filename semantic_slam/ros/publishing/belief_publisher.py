"""Publishes the belief and the views derived from it: pose, path, markers, detections and transforms."""

from collections.abc import Callable
from typing import Any, ClassVar

from rclpy.node import Node

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import compose
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.messages.typestore import serialize
from semantic_slam.pipeline.plain_views import MarkersView, pose_view
from semantic_slam.ros.publishing.frames import Frames
from semantic_slam.ros.publishing.object_detections import ObjectDetections
from semantic_slam.ros.publishing.path_publisher import PathPublisher
from semantic_slam.ros.publishing.retold_beliefs import RetoldBeliefs
from semantic_slam.ros.publishing.transforms import Transforms
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, private_name, receive


class BeliefPublisher:
    """Publishes one belief per keyframe, with pose, path, markers, TF and, if vision_msgs is installed, detections."""

    STATE: ClassVar[tuple[str, ...]] = ("_path", "_markers_view", "_T_odom_body")

    def __init__(self, node: Node, frames: Frames, lossless: bool) -> None:
        self._map = frames.map
        self._belief = RetoldBeliefs(node, _outlet(node, topics.BELIEF, qos.result(lossless)), frames.map)
        self._pose = _outlet(node, topics.POSE, qos.result(lossless))
        self._path = PathPublisher(node, frames.map)
        self._markers = _outlet(node, topics.MARKERS, qos.latched())
        self._transforms = _transforms(node, frames) if is_installed(topics.TYPES[topics.TF]) else None
        has_vision = all(map(is_installed, topics.VISION_TYPES.values()))
        self._detections = ObjectDetections(node, frames.map) if has_vision else None
        self._markers_view = MarkersView(frames.map)
        self._T_odom_body: Array | None = None

    def begin(self) -> None:
        """Start another run: clear the path, the transforms and the beliefs that are kept for late readers."""
        self._belief.forget()
        self._path.begin()
        self._T_odom_body = None
        if self._transforms is not None:
            self._transforms.begin()

    def broadcast_odom(self, does: bool) -> None:
        """Whether to publish TF from the odometry frame to the body, too."""
        if self._transforms is not None:
            self._transforms.broadcasts_odom = does

    def publish(
        self, belief: HybridBelief, T_previous_current: Array, T_odom_start: Array | None, *, is_repeated: bool = False
    ) -> None:
        """Publish a belief; ``T_previous_current`` is its keyframe's odometry, from ``T_odom_start`` for the first one.

        ``is_repeated``: belief and pose were published before; only what shows the newest state is published: path,
        markers, detections and transforms.
        """
        estimate = pose_view(belief, self._map)
        if not is_repeated:
            self._belief.send(belief)
            self._pose.send(encode(estimate))
        self._path.publish(estimate)
        self._markers.send(serialize(self._markers_view.of(belief)))
        if self._detections is not None:
            self._detections.publish(belief)
        before = T_odom_start if self._T_odom_body is None else self._T_odom_body
        if before is not None:
            self._T_odom_body = compose(before, T_previous_current)
            if self._transforms is not None:
                self._transforms.believe(estimate.pose, self._T_odom_body)

    def go_on(self, belief: HybridBelief | None, submit: Callable[[Callable[[Any], None], Any], None]) -> None:
        """After a restart, publish the newest belief again, and to readers that come late also those that follow.

        It may not have been delivered; subscribers recognise it by its keyframe. ``submit`` queues for the worker.
        """
        self._belief.go_on(belief, submit)

    def wait_for_acknowledgement(self) -> None:
        for outlet in (self._belief, self._pose, self._markers, self._path):
            outlet.wait_for_acknowledgement()


def _outlet(node: Node, topic: str, profile: Any) -> Outlet:
    return Outlet(node, private_name(topic), topics.TYPES[topic], profile, may_be_overridden=True)


def _transforms(node: Node, frames: Frames) -> Transforms:
    transforms = Transforms(frames, Outlet(node, topics.TF, topics.TYPES[topics.TF], qos.transforms()).send)
    receive(node, topics.ODOMETRY, transforms.hear, qos.sensor_input(topics.ODOMETRY, lossless=False))
    return transforms

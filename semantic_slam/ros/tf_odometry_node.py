"""Node ``tf_odometry``: publishes on topic odom the odometry of a source that tells it on /tf alone.

Other nodes listen to its topic odom as to that of any other source. Its covariances are zero, which means not stated:
the noise is that of odometry.* in the configuration. Needs tf2_msgs. It takes what comes, as /tf is not kept for
readers that come late. For a lossless replay ``semantic_slam import bag --odom /tf`` makes a bag with topic odom.

Parameters:
  odom_frame       frame in which the odometry moves (default odom)
  base_frame       frame of the robot's body, which has to be perception.base_frame of the other nodes (default
                   base_link): a child of odom_frame on /tf, or fixed to one by /tf_static
"""

import time
from collections.abc import Callable
from typing import Any

from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.standard import odometry_to_message
from semantic_slam.messages.tf_odometry import TfOdometry
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.ros.node.health import InputMonitor, transforms_status
from semantic_slam.ros.node.parameters import declare_fixed, refuse_undeclared
from semantic_slam.ros.node.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, relative_name


class TfOdometryNode(PipelineNode):
    """ROS node that wraps :class:`TfOdometry`."""

    def __init__(self) -> None:
        super().__init__("tf_odometry")
        if self.lossless:
            raise InputError(
                "parameter lossless is true, and tf_odometry takes of /tf what comes; leave it out, and replay"
                " losslessly what `semantic_slam import bag --odom /tf` makes of the bag"
            )
        fixed = TransformTree()
        self._tf = TfOdometry(
            declare_fixed(self, "odom_frame", "odom"), declare_fixed(self, "base_frame", "base_link"), fixed
        )
        name, kind = relative_name(topics.ODOMETRY), topics.TYPES[topics.ODOMETRY]
        self._odometry = Outlet(self, name, kind, qos.transforms(), may_be_overridden=True)
        self._listen(topics.TF_STATIC, fixed.add)
        self._listen(topics.TF, self._pass_on, required=True)
        refuse_undeclared(self)
        self._moving = InputMonitor(f"{self._tf.name} on {topics.TF}", time.monotonic())
        self.health.add_source(lambda: [transforms_status(self._tf.lack, self._moving, time.monotonic())])

    def _listen(self, topic: str, take: Callable[[Any], None], *, required: bool = False) -> None:
        def handle(data: bytes) -> None:
            take(deserialize(data, topics.TYPES[topic]))

        self.listen(topic, handle, qos.sensor_input(topic, lossless=False), required=required)

    def _pass_on(self, message: Any) -> None:
        """Publish the odometry of a message on /tf, once per stamp."""
        for estimate in self._tf.read(message):
            self._moving.arrived(time.monotonic())
            self._odometry.send(serialize(odometry_to_message(estimate)))
        if self._tf.num_repeated:
            self.repeated[topics.TF] = self._tf.num_repeated


main = main_of(TfOdometryNode, __doc__ or "")

"""Node ``backend_<n>``: computes the mixture components (hypotheses) that one backend owns.

Parameters:
  backend_id  its number, less than the manager's parameter backends; -1 (default): taken from the end of the node's
              name, 1 for backend_1
"""

import re

from rclpy.qos import QoSProfile

from semantic_slam.errors import InputError
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.protocol import Candidates, Components, MissedKeyframes
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.ros.node.health import Status, disk_status, dropped_status, rebuilt_status
from semantic_slam.ros.node.parameters import declare_fixed, refuse_undeclared
from semantic_slam.ros.node.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.rounds.liveliness import Sign
from semantic_slam.ros.rounds.work_order import Answer, WorkOrder
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, relative_name

MATCH_S = 20.0


class BackendNode(PipelineNode):
    """Answers keyframes with candidates and commits with components."""

    def __init__(self, backend_class: type[Backend] = Backend) -> None:
        super().__init__("backend_0")
        given = declare_fixed(self, "backend_id", -1)
        refuse_undeclared(self)
        self.backend_id = given if given >= 0 else _id_in_name(self.get_name())
        self._rounds = WorkOrder(lambda: backend_class(self.backend_id, stores_checkpoints=True))
        self._sign = Sign(self, self.backend_id)
        self._outlets = {
            Candidates: self._outlet(topics.CANDIDATES),
            Components: self._outlet(topics.COMPONENTS),
            MissedKeyframes: self._outlet(topics.MISSED),
        }
        self._statuses = self._health()  # replaced by the worker, published by the executor
        self.health.add_source(lambda: self._statuses)
        self._follow(topics.RUN_CONFIGURATION, qos.latched_by_any())
        self._follow(topics.KEYFRAMES, qos.everything())
        self._follow(topics.COMMITS, qos.everything())

    def _outlet(self, topic: str) -> Outlet:
        return Outlet(self, relative_name(topic), topics.TYPES[topic], qos.everything())

    def _follow(self, topic: str, profile: QoSProfile) -> None:
        def handle(data: bytes) -> None:
            before = self._rounds.num_replayed
            self._send(self._rounds.take(data, topics.TYPES[topic], more=self.worker.has_more))
            if self._rounds.num_replayed > before:
                self.get_logger().info(f"{self._rounds.num_replayed - before} keyframes replayed to rebuild components")
            self._statuses = self._health()
            self.repeated = self._rounds.repeated.copy()

        self.listen(topic, handle, profile)

    def _health(self) -> list[Status]:
        rounds = self._rounds
        rebuilt = rebuilt_status(rounds.num_rebuilt, rounds.num_replayed, rounds.checkpoint_faults)
        return [dropped_status(rounds.dropped), disk_status(rounds.disk_fault), rebuilt]

    def close(self) -> None:
        """Leave the folders with the checkpoints of its runs."""
        self._rounds.close()

    def _send(self, answers: list[Answer]) -> None:
        for answer in answers:
            outlet = self._outlets[type(answer)]
            outlet.wait_for_readers(1, MATCH_S)  # an answer sent before DDS has matched the manager would be lost
            outlet.send(encode(answer))


def _id_in_name(name: str) -> int:
    match = re.fullmatch(r".*_(\d+)", name)
    if match is None:
        raise InputError(f"node name {name} ends in no number; name it backend_0 or set the parameter backend_id")
    return int(match.group(1))


main = main_of(BackendNode, __doc__ or "")

"""Base of all nodes: lifecycle, a worker thread fed by subscription callbacks, diagnostics, and ``main``.

Callbacks on the executor's thread only queue messages; the worker thread processes them. Nodes are lifecycle nodes,
which configure and activate themselves unless parameter ``autostart`` is false.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile

from semantic_slam.cli.exit_codes import CommandParser, exit_code, leave
from semantic_slam.errors import InputError, MessageError, one_line
from semantic_slam.messages import topics
from semantic_slam.ros.node.backlog import Backlog
from semantic_slam.ros.node.diagnostics import Diagnostics
from semantic_slam.ros.node.health import repeated_status
from semantic_slam.ros.node.interrupt import Interrupt
from semantic_slam.ros.node.parameters import declare_fixed
from semantic_slam.ros.node.ros_arguments import parsed, without_ros_arguments
from semantic_slam.ros.node.worker import Worker
from semantic_slam.ros.wire.qos import FAST, FAST_DEPTH, PICTURES, SENSOR_DEPTH
from semantic_slam.ros.wire.shared_memory import remove_remains
from semantic_slam.ros.wire.transport import receive, relative_name

QUIET_TICK_S = 0.1
QUIET_TICKS = 3
LOOK_S = 0.2
"""Period [s] of polling for a publisher."""
SAY_AGAIN_S = 10.0
"""Minimum interval between repeated warnings on the console."""


STREAMS = frozenset(
    {
        *PICTURES,
        topics.DETECTIONS,
        topics.ODOMETRY,
        topics.IMU,
        topics.TF,
        topics.GROUND_TRUTH_ODOMETRY,
        topics.GROUND_TRUTH_ASSOCIATIONS,
    }
)
"""Streamed inputs: in live operation an inactive node discards and counts them; it queues all other messages."""
INPUTS = STREAMS | {topics.CAMERA_INFO, topics.INITIAL_POSE, topics.TF_STATIC}
"""Topics that other packages publish: their QoS may be overridden."""
MOST_BEHIND = {topic: FAST_DEPTH if topic in FAST else SENSOR_DEPTH for topic in (*STREAMS, topics.MEASUREMENTS)}
"""Maximum queue length by topic, in live operation; of a full queue the oldest message is discarded and counted."""
BEHIND = "came faster than it could be used"
PASSED = "came while the node was not active"
SHUTDOWN_S = 0.2
"""Delay of a requested shutdown, so that the service response is sent first."""


class PipelineNode(LifecycleNode):  # type: ignore[misc]  # rclpy is not followed by mypy
    """Lifecycle node whose subscriptions hand serialised messages to a worker thread, which runs while it is active."""

    most_behind: Mapping[str, int] = MOST_BEHIND

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._service_change_state.callback = _refusing(self._service_change_state.callback)
        self._starts_itself = declare_fixed(self, "autostart", True)
        self.is_active = False
        self.lossless = declare_fixed(self, "lossless", False)
        self.health = Diagnostics(self)
        self.worker = Worker(self._failed)
        self.fault: Exception | None = None
        self.refused: Counter[str] = Counter()  # messages not used, by topic and kind; two threads add: sum a copy
        self.repeated: Counter[str] = Counter()  # messages received more than once, by topic
        self.health.add_source(lambda: [repeated_status(self.repeated.copy())])
        self._arrivals = 0
        self._backlogs: dict[str, Backlog] = {}  # by topic
        self._newest: dict[str, Callable[[], None]] = {}  # by topic: queues the newest latched message on activation

    def listen(
        self,
        topic: str,
        handle: Callable[[bytes], None],
        qos: QoSProfile,
        *,
        type_name: str = "",
        required: bool = False,
        ends: bool = True,
        waits: bool = True,
    ) -> None:
        """Subscribe: ``handle`` is called on the worker's thread with each serialised message.

        ``required``: diagnostics report a silent topic. ``ends``: False for topics that continue after the end of a
        replay, which :meth:`when_drained` must ignore. ``waits``: False for topics whose messages an inactive node
        discards in live operation, like :data:`STREAMS`; of a latched topic it keeps the newest one.
        """
        monitors: list[Any] = []
        is_bounded = not self.lossless and topic in self.most_behind
        backlog = self._backlogs.setdefault(topic, Backlog(self.most_behind[topic])) if is_bounded else None

        def queue_message(data: bytes) -> None:
            if not self.is_active and not self.lossless and (topic in STREAMS or not waits):
                if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                    self._newest[topic] = partial(queue_message, data)
                else:
                    self.refused[f"{topic}: {PASSED}"] += 1
                return
            self._arrivals += ends
            for monitor in monitors:
                monitor.arrived(time.monotonic())
            if backlog is None:
                self.worker.submit(lambda data: self.guarded(topic, partial(handle, data)), data)
            elif backlog.add(data):
                self.refused[f"{topic}: {BEHIND}"] += 1
            else:
                self.worker.submit(lambda backlog: self.guarded(topic, lambda: handle(backlog.take())), backlog)

        is_input = topic in INPUTS
        name = receive(self, topic, queue_message, qos, type_name, self.health.incompatible, may_be_overridden=is_input)
        if required:
            monitors.append(self.health.monitor(name))

    def guarded(self, topic: str, handle: Callable[[], None]) -> None:
        """Call ``handle`` for a message of this topic; MessageError is counted and logged and does not end the node."""
        try:
            handle()
        except MessageError as fault:
            self.refused[f"{topic}: {fault.kind}"] += 1
            named = str(fault) if str(fault).startswith(f"{topic}: ") else f"{topic}: {fault}"
            self.get_logger().warning(named, throttle_duration_sec=SAY_AGAIN_S)

    def listen_to_one_of(
        self, handlers: Mapping[str, Callable[[bytes], None]], profile_of: Callable[[str], QoSProfile]
    ) -> None:
        """:meth:`listen` to the first of several topics that has a publisher, polled until one has; it is required."""
        if len(handlers) == 1:
            ((topic, handle),) = handlers.items()
            self.listen(topic, handle, profile_of(topic), required=True)
            return
        names = {topic: self.resolve_topic_name(relative_name(topic)) for topic in handlers}
        waiting = self.health.monitor(" or ".join(reversed(names.values())))

        def look() -> None:
            for topic, handle in handlers.items():
                if self.count_publishers(names[topic]):
                    self.destroy_timer(timer)
                    self.health.forget(waiting)
                    self.listen(topic, handle, profile_of(topic), required=True)
                    return

        timer = self.create_timer(LOOK_S, look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def when_drained(self, handle: Callable[[Any], None], item: Any) -> None:
        """Call ``handle(item)`` on the worker's thread once no more messages arrive and all queued ones are processed.

        Meant for the end of a replay, when every message is acknowledged but may not have been taken yet: messages of
        different topics are not ordered, so the end marker may overtake the last ones. Waits for ``QUIET_TICKS`` ticks
        of ``QUIET_TICK_S`` without an arrival.
        """
        state = {"quiet": 0, "received": -1}

        def tick() -> None:
            state["quiet"] = state["quiet"] + 1 if state["received"] == self._arrivals else 0
            state["received"] = self._arrivals
            if state["quiet"] == QUIET_TICKS:
                self.destroy_timer(timer)
                self.worker.submit(handle, item)

        timer = self.create_timer(QUIET_TICK_S, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def begin(self) -> None:
        """Configure and activate the node; with ``autostart`` false, log how to do so instead."""
        if not self._starts_itself:
            self.get_logger().info(f"waits: ros2 lifecycle set {self.get_fully_qualified_name()} configure, activate")
            return
        self.trigger_configure()
        self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing to do: parameters are read in the constructor."""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start or resume the worker."""
        self.resume()
        self.say_ready()
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause the worker."""
        self.pause_work()
        self.health.speaks = False
        self.get_logger().info("paused")
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node after ``SHUTDOWN_S``, once the response has been sent."""
        self.create_timer(SHUTDOWN_S, self.end, clock=Clock(clock_type=ClockType.STEADY_TIME))
        return TransitionCallbackReturn.SUCCESS

    def resume(self) -> None:
        """Start or resume work; latched messages kept while inactive are queued."""
        self.is_active = True
        for queue_message in self._newest.values():
            queue_message()
        self._newest.clear()
        self.worker.start()

    def pause_work(self) -> None:
        """Stop working until :meth:`resume`."""
        self.is_active = False
        self.worker.suspend()

    def say_ready(self) -> None:
        """Log that the node is ready, and from then on problems and missing inputs as they change."""
        self.get_logger().info("ready")
        self.health.speaks = True

    def end(self) -> None:
        """Shut down rclpy, which ends the node; may be called from any thread."""
        rclpy.try_shutdown()

    def say_left(self) -> None:
        """Log what a node that was told to end has received and not used, in live operation."""
        left = ", ".join(f"{len(backlog)} x {topic}" for topic, backlog in self._backlogs.items() if len(backlog))
        if left:
            self.get_logger().warning(f"ended before it had used {left}")

    def close(self) -> None:
        """Release the node's resources; called after it has ended and its worker was told to stop."""

    def destroy_node(self) -> None:
        """Destroy the node, so that others see it leave and the middleware frees its shared memory."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()  # rclpy does not, and it keeps the underlying node alive

    def _failed(self, fault: Exception) -> None:
        if rclpy.ok():  # after an interrupt publishing fails, which is no fault
            self.fault = fault
            self.end()


def _refusing(change_state: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Handler of ChangeState that answers False to an invalid transition, which in rclpy would crash the node."""

    def answer(request: Any, response: Any) -> Any:
        try:
            return change_state(request, response)
        except RuntimeError:
            response.success = False
            return response

    return answer


def run_node(make_node: Callable[[], PipelineNode]) -> None:
    """Run a node until it ends or is interrupted. Raises InputError, and the exception that stopped its worker."""
    remove_remains()
    parsed(rclpy.init, sys.argv)
    executor = SingleThreadedExecutor()
    interrupt = Interrupt(executor.wake)
    node = None
    try:
        node = make_node()
        executor.add_node(node)
        if not interrupt.done():
            node.begin()
        executor.spin_until_future_complete(interrupt)
    except ExternalShutdownException:
        pass
    except ParameterException as fault:
        raise InputError(f"{one_line(fault)}; see config/default.yaml") from None
    except Exception:
        if rclpy.ok():  # after SIGTERM creating entities and publishing fail, which is no fault
            raise
    finally:
        if node is not None:
            node.worker.stop()
            node.say_left()
            node.close()
        rclpy.try_shutdown()
        if node is not None:
            node.destroy_node()
    if node is not None and node.fault is not None:
        raise node.fault


def main_of(make_node: Callable[[], PipelineNode], description: str) -> Callable[[], None]:
    """The ``main`` of a node's executable; ``description`` is what ``--help`` prints."""

    def command() -> None:
        words = without_ros_arguments(sys.argv)
        CommandParser(
            description=description.replace("``", ""),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            epilog="ROS arguments follow --ros-args: -p NAME:=VALUE, --params-file FILE, -r FROM:=TO.",
        ).parse_args(words[1:])
        run_node(make_node)

    def ended_or_interrupted() -> None:
        with suppress(KeyboardInterrupt):  # an interrupted node exits successfully
            command()

    return lambda: leave(exit_code(ended_or_interrupted))

"""Node ``hypothesis_manager``: takes measurements and odometry, publishes the hybrid belief, pose, path and markers.

Services (semantic_slam_msgs/srv):
  ~/find_objects     FindObjects: the mapped objects of a class, or that look like a vector or a text, in a region
  ~/get_object       GetObject: everything known about one object
  ~/query_place      QueryPlace: which objects are in a region, and which expected ones are missing there
  ~/explain          Explain: the evidence for an object's class
  ~/get_path         GetPath: the robot's path since the start of the run
  ~/find_lookalike   FindLookalike: which mapped object looks like an image crop
  ~/reset            std_srvs/Trigger: end the run and start another one at keyframe 0, on the same map
  ~/load_map         LoadMap: end the run and start another one at keyframe 0, on a saved map
  ~/pause            std_srvs/SetBool: make no keyframes; odometry is still received
  ~/save_map         SaveMap: write the map to a file, from which a later run can start

Parameters, besides those of config/default.yaml:
  backends           number of backend nodes, backend_0, backend_1, ... (default 1)
  backend_timeout_s  a backend that does not answer for this many seconds is given up (default 60) (*)
  map_frame          name of the frame of beliefs, pose, path, markers, TF and initialpose (default map)
  odom_frame         name of the odometry frame in TF (default "": the frame_id of the odometry messages)
  broadcast_odom     also publish TF from odom_frame to the odometry's child_frame_id, for robots whose driver does not
                     (default false) (*)
  has_imu            in 3D runs, wait for topic imu, which measures roll and pitch (default false)
  map_prior          FILE.map or objects.json with the objects known in advance (default none)
  source_bag         bag being replayed, recorded as provenance in the run configuration (default none)
  journal            folder of the journal on disk; a restarted node replays it and continues the run (default none)
  resume             continue from an unfinished journal (default true); false: rename it to journal.old
  lossless           true in a replay by bag_player at rate 0 (default false)
(*): may be set while the node runs, as may keyframes.policy, keyframes.distance_m, keyframes.angle_rad and, from one
budget to another, open_world.time_budget_ms.
"""

import json
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

from semantic_slam.errors import MessageError
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, parse_map_prior
from semantic_slam.maps.map_file import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode, from_message
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.assembly.frame_count import FrameCount
from semantic_slam.pipeline.journal.event_journal import CHANGE, END, PAUSE, RESTART, SESSION, EventJournal
from semantic_slam.pipeline.journal.journal import SNAPSHOT
from semantic_slam.pipeline.journal.journal_of_run import open_journal
from semantic_slam.pipeline.journal.journaled_pool import JournaledPool
from semantic_slam.pipeline.journal.snapshots import Snapshots
from semantic_slam.pipeline.preamble import checked_initial_pose
from semantic_slam.pipeline.session import Session
from semantic_slam.ros.manager_parameters import ManagerParameters
from semantic_slam.ros.node.changes import Values
from semantic_slam.ros.node.health import Level, Status, dropped_status, model_fit_status
from semantic_slam.ros.node.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.node.repeats import Repeats
from semantic_slam.ros.node.run_inputs import imu_source
from semantic_slam.ros.publishing.belief_publisher import BeliefPublisher
from semantic_slam.ros.rounds.ros_pool import RosPool
from semantic_slam.ros.services.belief_service import BeliefService, BeliefUpdate
from semantic_slam.ros.services.explain_service import ExplainService
from semantic_slam.ros.services.in_background import InBackground
from semantic_slam.ros.services.lookalike_service import LookalikeService
from semantic_slam.ros.services.map_service import MapService
from semantic_slam.ros.services.object_services import ObjectServices
from semantic_slam.ros.services.run_changes import RunChanges
from semantic_slam.ros.services.session_services import SessionServices
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, private_name


class HypothesisManagerNode(PipelineNode):
    """ROS node that wraps the keyframe assembler and the hypothesis manager."""

    STATE: ClassVar[tuple[str, ...]] = (
        "refused",
        "_frames",
        "_repeats",
        "_transforms",
        "_publisher",
        "_is_paused",
        "_belief_stamp_ns",
    )

    def __init__(self) -> None:
        super().__init__("hypothesis_manager")
        parameters = ManagerParameters.declared(self)
        self._configuration, self._map_prior = parameters.configuration, parameters.map_prior
        self._map_frame = parameters.frames.map
        self._set_up_run(parameters)
        self._publisher = BeliefPublisher(self, parameters.frames, self.lossless)
        self._publisher.broadcast_odom(parameters.broadcasts_odom)
        self._create_services()
        self._progress = Outlet(
            self, private_name(topics.MANAGER_PROGRESS), topics.TYPES[topics.MANAGER_PROGRESS], qos.latched()
        )
        self._listen()
        self.worker.submit(self._recover, None)
        self._changes = RunChanges(self, lambda: self._session, self.change, self._pool, self._publisher)
        self.health.add_source(lambda: [*self._pool.statuses(), self._status, *self._statuses()])

    def _set_up_run(self, parameters: ManagerParameters) -> None:
        """Open the journal and create the backends' pool and the first session."""
        self._pool = RosPool(self, range(parameters.num_backends), parameters.backend_timeout_s)
        self._transforms = TransformTree()
        waits = self.lossless
        imu = imu_source(self, self._configuration, self._transforms, waits=waits) if parameters.has_imu else None
        self._has_imu = imu is not None
        of_run = (self._configuration, self._map_prior, parameters.source)
        say = self.get_logger().warning
        journal = open_journal(parameters.journal, *of_run, resume=parameters.resume, say=say)
        self._journal = EventJournal(journal, self._handlers())
        self._snapshots = Snapshots(journal, self._configuration.history, self._pool)
        self._pool_of_run = JournaledPool(self._pool, journal)
        self._session = Session(self._configuration, self._map_prior, parameters.source, imu=imu)
        self._frames = FrameCount(is_gapless=self.lossless)
        self.repeated = self._pool.repeated
        self._repeats = Repeats(self.repeated)
        self._belief: HybridBelief | None = None  # the newest
        self._announced, self._belief_stamp_ns = -1, 0
        self._is_paused = self._is_recovering = self._is_finished = False
        self._status = dropped_status(self.refused)  # replaced by the worker, published by the executor
        self._explanation = model_fit_status(None)  # replaced by the worker, published by the executor

    def _create_services(self) -> None:
        self._background = InBackground(self, "services")
        self._explain = ExplainService(self)
        self._belief_services: tuple[BeliefService, ...] = (
            ObjectServices(self, self._background, self._configuration.semantic_model),
            LookalikeService(self._background, self._configuration.semantic_model),
            MapService(self, self._run),
            self._explain,
        )
        self._session_services = SessionServices(self, self._background, self, read_map_prior)

    def _listen(self) -> None:
        # The order matters: when several messages are ready, the executor serves the subscription created first.
        self._input(topics.INITIAL_POSE, self._set_initial_pose, required=False)
        if self._has_imu:
            if is_installed(topics.TYPES[topics.TF_STATIC]):
                self._input(topics.TF_STATIC, self._transforms.add, required=False)
            self._input(topics.IMU, lambda message: self._session.assembler.add_imu(message))
        self._input(topics.ODOMETRY, lambda message: self._session.assembler.add_odometry(message))
        if strategy_of(self._configuration).wants_identities:
            identities = topics.GROUND_TRUTH_ASSOCIATIONS
            self._input(identities, lambda m: self._session.assembler.add_identities(from_message(m)), required=False)
        handle = self._kept(topics.MEASUREMENTS, self._add_measurements)
        self.listen(topics.MEASUREMENTS, handle, qos.result(self.lossless), required=True)
        self.listen(topics.CLASSIFIER_PROGRESS, self._classifier_progress, qos.latched_by_any())

    def _input(self, topic: str, add: Callable[[Any], None], *, required: bool = True) -> None:
        self.listen(topic, self._kept(topic, add), qos.sensor_input(topic, self.lossless), required=required)

    def _kept(self, topic: str, add: Callable[[Any], None]) -> Callable[[bytes], None]:
        """Handler that appends each message to the journal before using it; repeats in a replay are ignored."""
        self._journal.listen(topic, partial(self._use, topic, add))

        def handle(data: bytes) -> None:
            if not (self.lossless and not self._is_finished and self._repeats.is_known(topic, data)):
                self._journal.happen(topic, data)
                if not self._is_finished:
                    self._snapshots.take(self, self._session)

        return handle

    def _use(self, topic: str, add: Callable[[Any], None], data: bytes) -> None:
        self._go_on_after_end()
        add(deserialize(data, topics.TYPES[topic]))
        self._infer()
        former = self._session
        if former.assembler.is_over:  # stamps restarted from an earlier time, e.g. a bag that is played again
            self._infer(at_end=True)
            self._begin(former.map_prior)
            self._session.assembler.go_on_from(former.assembler)
            self._infer()

    def _go_on_after_end(self) -> None:
        """If the replay has ended, start another session, whose messages count as not received before."""
        if self._is_finished:
            self._begin(self._session.map_prior)

    def _begin(self, map_prior: MapPrior | None) -> None:
        """Start another run on this map; the backends follow when its configuration is announced."""
        if self._is_finished:
            self._is_finished = self.health.finished = False
            self._frames, self._repeats = self._frames.anew(), Repeats(self.repeated)
        self.get_logger().info(f"the run has ended after {self._session.num_keyframes} keyframes; another one begins")
        self._session = self._session.follower(map_prior)
        self._session.assembler.is_paused = self._is_paused
        self._publisher.begin()
        self._belief, self._belief_stamp_ns, self._announced = None, 0, -1
        for service in self._belief_services:
            service.begin()
        self._explanation = model_fit_status(None)

    def resume(self) -> None:
        """Start working; after :meth:`pause_work`, make keyframes again."""
        if self.is_active:
            self.worker.submit(lambda _: self.pause(False), None)
        super().resume()

    def pause_work(self) -> None:
        """Make no keyframes, but keep receiving odometry, so that motion during the pause is known."""
        self.worker.submit(lambda _: self.pause(True), None)

    def reset(self) -> None:
        """End the run and start another one at keyframe 0, on the same map."""
        self.load(self._session.map_prior)

    def check(self, prior: MapPrior) -> None:
        """Check that a run can start on this map. Raises InputError; may be called on any thread."""
        self._session.check(prior)

    def load(self, map_prior: MapPrior | None) -> None:
        """End the run and start another one on this map; journaled."""
        self._journal.record(SESSION, b"" if map_prior is None else map_prior.to_json().encode())
        self._restart(map_prior)

    def _restart(self, map_prior: MapPrior | None) -> None:
        self._begin(map_prior)
        self._infer()

    def pause(self, paused: bool) -> None:
        """Stop or resume making keyframes; journaled."""
        self._journal.happen(PAUSE, b"1" if paused else b"0")

    def _set_paused(self, paused: bool) -> None:
        self._is_paused = self._session.assembler.is_paused = paused

    def change(self, values: Values) -> None:
        """Use other values of parameters that may change during a run; journaled."""
        if self._changes.changed(values) != self._session.configuration:
            self._journal.happen(CHANGE, json.dumps(values).encode())

    def close(self) -> None:
        """Cancel pending service requests, including a running explanation, and leave the folder of checkpoints."""
        self._pool.close()
        self._explain.close()
        self._background.close()

    def _recover(self, _: None) -> None:
        """Replay the journal up to where the last process stopped, then announce the progress."""
        self._is_recovering = True
        self._snapshots.restore(self, self._session, self._pool_of_run)
        of_snapshot = self._session.num_keyframes
        for event in self._journal.past():
            if self.lossless and event.name != SNAPSHOT:
                self._repeats.is_known(event.name, event.data)
            self.guarded(event.name, partial(self._journal.happen_again, event))
        if self._session.num_keyframes:
            text = f"{self._session.num_keyframes} keyframes of the journal are there again"
            self.get_logger().info(f"{text}, {of_snapshot} of them from a snapshot" if of_snapshot else text)
        self._journal.recovered(self._session.num_keyframes)
        if not self.lossless:
            self._publisher.go_on(self._belief, self.worker.submit)  # the last one may not have reached anybody
        self._is_recovering = False
        self._journal.happen(RESTART)
        if self._session.configuration != self._configuration:
            self._changes.state()
        self._announce(finished=self._is_finished)

    def _handlers(self) -> dict[str, Callable[[bytes], None]]:
        """What handles the events of the journal, besides those that :meth:`_kept` adds."""
        return {
            SESSION: lambda data: self._restart(parse_map_prior(data.decode(), "journal") if data else None),
            PAUSE: lambda data: self._set_paused(data == b"1"),
            CHANGE: lambda data: self._session.change(self._changes.changed(json.loads(data))),
            topics.CLASSIFIER_PROGRESS: self._count_lost,
            END: lambda _: self._finish(),
            RESTART: lambda _: self._frames.interrupted(),
            SNAPSHOT: lambda _: self._snapshots.pass_by(self._session),
        }

    def _set_initial_pose(self, message: Any) -> None:
        self._session.set_initial_pose(checked_initial_pose(from_message(message), self._map_frame))

    def _add_measurements(self, message: Any) -> None:
        measurements = self._frames.measured(from_message(message))
        if measurements is not None:
            self._session.assembler.add_measurements(measurements)

    def _infer(self, *, at_end: bool = False) -> None:
        try:
            for keyframe, belief in self._session.beliefs(self._pool_of_run, at_end=at_end):
                self._state(belief, keyframe)
        finally:
            unused = self._session.dropped + self._frames.missed + self.refused.copy() + self._pool.refused
            if not self._is_recovering:  # a part of the journal's counts would look like those of a fresh start
                self._status = dropped_status(unused)
            for line in self._session.news():
                self.get_logger().warning(line)
        self._announce(finished=False)

    def _state(self, belief: HybridBelief, keyframe: Keyframe) -> None:
        """Publish a belief once the journal records that led to it are on disk."""
        if not self._is_recovering:
            self._journal.sync()
        # In a lossless replay late subscribers get the whole history; live subscribers have received these beliefs.
        start, is_repeated = self._session.assembler.first_pose, self._is_recovering and not self.lossless
        self._publisher.publish(belief, keyframe.odometry, start, is_repeated=is_repeated)
        self._belief = belief
        update = BeliefUpdate(
            belief=belief,
            measurements=keyframe.measurements,
            map_prior=self._session.map_prior,
            kept_run=self._pool.kept,
        )
        for service in self._belief_services:
            service.update(update)
        self._explanation = model_fit_status(belief, self._session.carried, self._session.carried_spans)
        self._belief_stamp_ns = belief.stamp_ns
        self._snapshots.count()

    def _run(self) -> RunConfiguration:
        """Configuration of the current run. Raises InputError before its first keyframe."""
        return self._session.run

    def _classifier_progress(self, data: bytes) -> None:
        progress: ReplayProgress = decode(data, topics.TYPES[topics.CLASSIFIER_PROGRESS])
        if progress.finished and 0 < progress.stamp_ns < self._frames.stamp_ns and not self._is_finished:
            raise MessageError(f"{topics.CLASSIFIER_PROGRESS}: an end before the newest measurements", "out of turn")
        if self._is_progress_repeated(progress, data):
            return
        self._journal.happen(topics.CLASSIFIER_PROGRESS, data)
        self._announce(finished=False)
        if progress.finished:
            self.when_drained(self._end_of_replay, None)

    def _is_progress_repeated(self, progress: ReplayProgress, data: bytes) -> bool:
        """Whether this process has handled the message before; a resumed one still has to handle the replay's end."""
        if not progress.finished:
            return self._repeats.is_known(topics.CLASSIFIER_PROGRESS, data)
        self.repeated[topics.CLASSIFIER_PROGRESS] += self._is_finished
        return self._is_finished

    def _count_lost(self, data: bytes) -> None:
        progress: ReplayProgress = decode(data, topics.TYPES[topics.CLASSIFIER_PROGRESS])
        if not progress.finished:
            self._go_on_after_end()
        self._frames.lost(progress.frames)

    def _end_of_replay(self, _: None) -> None:
        self._journal.happen(END)
        self._publisher.wait_for_acknowledgement()
        self.health.publish()  # the final counts, before the recorder stops listening
        self._announce(finished=True)

    def _finish(self) -> None:
        """Process the remaining keyframes and mark the replay as finished."""
        self._infer(at_end=True)
        self._is_finished = self.health.finished = True

    def _announce(self, *, finished: bool) -> None:
        """Publish how many detection frames are done and the stamp of the newest; at the end, that of the last belief.

        A restarted player resumes from that frame, and the recorder waits for the last belief.
        """
        frames = self._frames.num_done(self._session.assembler.num_waiting)
        if self._is_recovering or (frames == self._announced and not finished):
            return
        self._announced = frames
        stamp_ns = self._belief_stamp_ns if finished else self._frames.stamp_ns
        self._progress.send(encode(ReplayProgress(stamp_ns, frames=frames, finished=finished)))

    def _statuses(self) -> list[Status]:
        number, waiting = str(self._session.num_keyframes), self._session.num_without_label
        text = f"{number} keyframes" + (f", {waiting} wait for the first detection with a label" if waiting else "")
        text += ", paused" if self._is_paused else ""
        fault = self._snapshots.fault
        of_journal = [Status("journal", Level.WARN, fault)] if fault else []
        faults = "; ".join(self._session.assembler.imu_faults)
        imu = [Status(topics.IMU, Level.WARN, faults)] if faults else []
        return [Status("keyframes", Level.OK, text, {"keyframes": number}), self._explanation, *of_journal, *imu]


main = main_of(HypothesisManagerNode, __doc__ or "")

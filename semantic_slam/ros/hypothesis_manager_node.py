"""Node ``hypothesis_manager``: measurements and odometry in, the hybrid belief and its plain views out.

Services (semantic_slam_msgs/srv):
  ~/find_objects     FindObjects: which mapped objects are of a class, and lie in a region
  ~/get_object       GetObject: all that is known of one
  ~/query_place      QueryPlace: what is at a place, and what should be there and is not
  ~/get_path         GetPath: the robot's path from its start on
  ~/find_lookalike   FindLookalike: which mapped object looks like a crop

Parameters, besides those of config/default.yaml:
  backends           number of backend nodes, backend_0, backend_1, ... (default 1)
  backend_timeout_s  a backend silent for so long is given up (default 60)
  map_prior          objects.json with the objects known before (default none)
  source_bag         bag being replayed, for the record (default none)
  journal            folder in which the run is kept on disk, so that this node goes on where it stood when it is
                     started again (default none)
  resume             go on from an unfinished journal (default true); false: it is set aside as journal.old
  lossless           true in a replay by bag_player at rate 0 (default false)
"""

import hashlib
import json
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import to_dict
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.build import initial_pose_of, make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode, from_message
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.detector_labels import with_labels
from semantic_slam.pipeline.first_word import FirstWord
from semantic_slam.pipeline.frame_count import FrameCount
from semantic_slam.pipeline.journal import Journal, NoJournal, Record
from semantic_slam.pipeline.journaled_pool import JournaledPool
from semantic_slam.pipeline.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.preamble import checked_initial_pose
from semantic_slam.pipeline.provenance import revision, source_text
from semantic_slam.ros import qos
from semantic_slam.ros.belief_publisher import BeliefPublisher
from semantic_slam.ros.health import Level, Status, dropped_status, explanation_status
from semantic_slam.ros.lookalike_service import LookalikeService
from semantic_slam.ros.object_services import ObjectServices
from semantic_slam.ros.parameters import declare_configuration, refuse_undeclared
from semantic_slam.ros.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.repeats import Repeats
from semantic_slam.ros.ros_pool import RosPool
from semantic_slam.ros.transport import Outlet, private_name
from semantic_slam.version import __version__

END = "end"
"""The journal's record of a replay's end: no more messages will come."""


class HypothesisManagerNode(PipelineNode):
    """Keyframe assembler and hypothesis manager behind topics."""

    def __init__(self) -> None:
        super().__init__("hypothesis_manager")
        self._configuration = declare_configuration(self)
        num_backends = int(self.declare_parameter("backends", 1).value)
        if num_backends < 1:
            raise InputError(f"parameter backends is {num_backends}; at least one backend is needed")
        timeout_s = float(self.declare_parameter("backend_timeout_s", 60.0).value)
        self._pool = RosPool(self, range(num_backends), timeout_s)
        self._map_prior = _map_prior(str(self.declare_parameter("map_prior", "").value))
        source_bag = str(self.declare_parameter("source_bag", "").value)
        journal = str(self.declare_parameter("journal", "").value)
        resume = bool(self.declare_parameter("resume", True).value)
        refuse_undeclared(self)
        self._source = _source(source_bag)
        self._journal = self._open_journal(journal, resume)
        self._first_word = FirstWord(self._configuration.semantic_model)
        self._assembler = KeyframeAssembler(
            self._configuration, has_identities=self._wants_identities, passes_over=self._first_word.passes_over
        )
        self._initial_pose: PoseEstimate | None = None
        self._manager: Engine | None = None
        self._frames = FrameCount()
        self._repeats = Repeats()
        self._adders: dict[str, Callable[[Any], None]] = {}  # by topic
        self._num_keyframes, self._announced, self._belief_stamp_ns = 0, -1, 0
        self._is_recovering = self._is_finished = False
        self._status = dropped_status(self.refused)  # replaced by the worker, published by the executor
        self._explanation = explanation_status(None)  # likewise
        self._publisher = BeliefPublisher(self, self.lossless)
        self._belief: HybridBelief | None = None  # the newest
        self._answers = LookalikeService(self, self._configuration.semantic_model), ObjectServices(self)
        self._progress = Outlet(
            self, private_name(topics.MANAGER_PROGRESS), topics.TYPES[topics.MANAGER_PROGRESS], qos.latched()
        )
        self._listen()
        self.worker.submit(self._recover, None)
        self.health.add_source(lambda: [*self._pool.statuses(), self._status, *self._statuses()])

    @property
    def _wants_identities(self) -> bool:
        return strategy_of(self._configuration).wants_identities

    def _listen(self) -> None:
        # In this order: of messages that are there at once, the executor takes those of the earlier subscription first.
        self._input(topics.INITIAL_POSE, lambda message: self._set_initial_pose(from_message(message)), required=False)
        self._input(topics.ODOMETRY, self._add_odometry)
        if self._wants_identities:
            identities = topics.GROUND_TRUTH_ASSOCIATIONS
            self._input(identities, lambda m: self._assembler.add_identities(from_message(m)), required=False)
        handle = self._kept(topics.MEASUREMENTS, self._add_measurements)
        self.listen(topics.MEASUREMENTS, handle, qos.result(self.lossless), required=True)
        self.listen(topics.CLASSIFIER_PROGRESS, self._classifier_progress, qos.latched())

    def _input(self, topic: str, add: Callable[[Any], None], *, required: bool = True) -> None:
        self.listen(topic, self._kept(topic, add), qos.sensor_input(topic, self.lossless), required=required)

    def _kept(self, topic: str, add: Callable[[Any], None]) -> Callable[[bytes], None]:
        """A handler that has its messages in the journal before it uses them; a replay's repetitions change nothing."""
        self._adders[topic] = add

        def handle(data: bytes) -> None:
            if not (self.lossless and self._repeats.is_known(topic, data)):
                self._journal.append(topic, data)
                self._use(topic, data)

        return handle

    def _use(self, topic: str, data: bytes) -> None:
        self._adders[topic](deserialize(data, topics.TYPES[topic]))
        self._infer(self._assembler.take())

    def _open_journal(self, folder: str, resume: bool) -> NoJournal:
        """Raises InputError where the folder has the journal of another run, or of one that cannot be repeated."""
        if not folder:
            return NoJournal()
        if self._configuration.open_world.time_budget_ms > 0.0:
            raise InputError(
                "parameter journal: with open_world.time_budget_ms a run cannot be repeated; set one or the other"
            )
        prior = "" if self._map_prior is None else self._map_prior.to_json()
        run = {
            "configuration": to_dict(self._configuration),
            "map_prior": hashlib.sha256(prior.encode()).hexdigest(),
            "source": self._source,
            "version": __version__,
        }
        return Journal(Path(folder), json.dumps(run, sort_keys=True), resume=resume)

    def _recover(self, _: None) -> None:
        """Go again through what the journal has, up to where the last process stood; then say where that is."""
        self._is_recovering = True
        while (record := self._journal.next) is not None:
            self._journal.take()
            if self.lossless:
                self._repeats.is_known(record.name, record.data)
            self.guarded(record.name, partial(self._happened, record))
        if self._num_keyframes:
            self.get_logger().info(f"{self._num_keyframes} keyframes of the journal are there again")
        if self._belief is not None and not self.lossless:
            self._publisher.repeat(self._belief)  # nobody may have had the last one
        self._is_recovering = False
        self._announce(finished=self._is_finished)

    def _happened(self, record: Record) -> None:
        if record.name == END:
            self._finish()
        elif record.name == topics.CLASSIFIER_PROGRESS:
            self._frames.lost(decode(record.data, topics.TYPES[record.name]).frames)
        elif record.name in self._adders:
            self._use(record.name, record.data)
        else:
            raise InputError(f"parameter journal: it goes on with {record.name} where no answer is due; remove it")

    def _set_initial_pose(self, estimate: PoseEstimate) -> None:
        if self._initial_pose is None and self._manager is None:
            self._initial_pose = checked_initial_pose(estimate)

    def _add_odometry(self, message: Any) -> None:
        self._publisher.note_odometry(message)
        self._assembler.add_odometry(message)

    def _add_measurements(self, message: Any) -> None:
        measurements = self._frames.measured(from_message(message))
        if measurements is not None:
            self._assembler.add_measurements(measurements)

    def _infer(self, keyframes: list[Keyframe], *, at_end: bool = False) -> None:
        try:
            for keyframe in self._first_word.released(keyframes, at_end=at_end):
                if self._manager is None:
                    self._manager = self._start(keyframe)
                belief = self._manager.process(keyframe)
                self._state(belief, keyframe)
        finally:
            lost = self._manager.lost if self._manager is not None else Counter[str]()
            self._status = dropped_status(self._assembler.dropped + self.refused + self._pool.refused + lost)
        self._announce(finished=False)

    def _state(self, belief: HybridBelief, keyframe: Keyframe) -> None:
        """Tell everybody, once nothing that led to the belief can be lost any more."""
        if not self._is_recovering:
            self._journal.sync()
        # Of a replay whoever comes late is sent everything; those who hear live beliefs have heard them.
        self._publisher.publish(belief, keyframe.odometry, is_repeated=self._is_recovering and not self.lossless)
        self._belief = belief
        for service in self._answers:
            service.belief = belief
        self._explanation = explanation_status(belief)
        self._num_keyframes += 1
        self._belief_stamp_ns = belief.stamp_ns

    def _start(self, first: Keyframe) -> Engine:
        pose, covariance = initial_pose_of(self._configuration)
        if self._initial_pose is not None:
            pose, covariance = self._initial_pose.pose, self._initial_pose.covariance
        run = make_run_configuration(
            with_labels(self._configuration, first.measurements, self._map_prior, self._first_word.labels),
            self._map_prior,
            pose,
            covariance,
            stamp_ns=first.stamp_ns,
            source=self._source,
            revision=revision(),
        )
        return Engine.of_run(run, JournaledPool(self._pool, self._journal))

    def _classifier_progress(self, data: bytes) -> None:
        progress: ReplayProgress = decode(data, topics.TYPES[topics.CLASSIFIER_PROGRESS])
        self._journal.append(topics.CLASSIFIER_PROGRESS, data)
        self._frames.lost(progress.frames)
        self._announce(finished=False)
        if progress.finished:
            self.when_drained(self._end_of_replay, None)

    def _end_of_replay(self, _: None) -> None:
        self._journal.append(END)
        self._finish()
        self._publisher.wait_for_acknowledgement()
        self.health.finished = True
        self.health.publish()  # the last counts, before whoever records stops listening
        self._announce(finished=True)

    def _finish(self) -> None:
        """All that is left."""
        self._infer(self._assembler.flush(), at_end=True)
        self._is_finished = True

    def _announce(self, *, finished: bool) -> None:
        """Tell the player how many detection frames are done with, and up to which stamp; at the end the last belief's.

        A player that is started again begins there, and a recorder waits for that belief.
        """
        frames = self._frames.num_done(self._assembler.num_waiting)
        if self._is_recovering or (frames == self._announced and not finished):
            return
        self._announced = frames
        stamp_ns = self._belief_stamp_ns if finished else self._frames.stamp_ns
        self._progress.send(encode(ReplayProgress(stamp_ns, frames=frames, finished=finished)))

    def _statuses(self) -> list[Status]:
        number, waiting = str(self._num_keyframes), self._first_word.num_waiting
        text = f"{number} keyframes" + (f", {waiting} wait for the first detection with a label" if waiting else "")
        return [Status("keyframes", Level.OK, text, {"keyframes": number}), self._explanation]


def _map_prior(path: str) -> MapPrior | None:
    return read_map_prior(Path(path)) if path else None


def _source(bag: str) -> str:
    return source_text(Path(bag), BagReader(Path(bag)).sha256()) if bag else ""


main = main_of(HypothesisManagerNode, __doc__ or "")

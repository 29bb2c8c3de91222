"""Offline pipeline: computes a belief bag from an input bag in this process.

bag -> FrameAssembler -> Classifier -> KeyframeAssembler -> Engine -> belief bag; the nodes use the same parts. Without
images PlacesAssembler takes the place of FrameAssembler and Classifier.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError, MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import BackendPool
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.sensor import sensor_pose
from semantic_slam.perception.frame import Frame
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.build_classifier import build_classifier
from semantic_slam.pipeline.detector_labels import are_asked_for, known_to_fit, labels_in
from semantic_slam.pipeline.diagnostics import dropped_message
from semantic_slam.pipeline.gravity.gravity_by_imu import ImuSource
from semantic_slam.pipeline.gravity.imu_use import NAME as IMU
from semantic_slam.pipeline.gravity.imu_use import left_out, unused_because
from semantic_slam.pipeline.inference_stage import InferenceStage
from semantic_slam.pipeline.input_topics import COPIED, InputTopics, find_topics
from semantic_slam.pipeline.interrupts import noted_interrupts
from semantic_slam.pipeline.preamble import Preamble, find_map_prior, read_preamble
from semantic_slam.pipeline.provenance import source_text


@dataclass(frozen=True)
class RunSummary:
    """Outcome of an offline run."""

    belief_bag: Path
    num_frames: int
    num_keyframes: int
    dropped: dict[str, int]  # counts of inputs not used and hypotheses dropped, by reason
    fault: InputError | None  # why the input ended early, if it did; everything before is in the belief bag


def run_bag(
    bag: str | Path,
    out_bag: str | Path,
    configuration: Configuration,
    map_prior: MapPrior | None = None,
    max_keyframes: int | None = None,
    pool: BackendPool | None = None,
) -> RunSummary:
    """Run the pipeline on ``bag``, writing the belief bag ``out_bag`` incrementally.

    ``map_prior`` None: the objects.json beside the bag, if there is one. ``pool`` None: a new pool with one backend in
    this process; pass one to inspect its backends afterwards. Raises InputError if not a single keyframe can be made;
    invalid input after the first keyframe ends the run and is returned in the summary.
    """
    if max_keyframes is not None and max_keyframes < 1:
        raise InputError(f"max_keyframes is {max_keyframes}; give 1 or more, or None for the whole bag")
    bag, out_bag = Path(bag), Path(out_bag)
    if out_bag.resolve() in (bag.resolve(), bag.resolve().parent):
        raise InputError(f"{out_bag}: is the input bag; name another output")
    with BagReader(bag) as reader:
        found = find_topics(bag, reader.topics)
        reader.check_definitions()
        if found.has_places_alone:
            print(f"{bag}: no {topics.IMAGE}; {topics.DETECTIONS} are used by the places that they tell")
        if told := left_out(configuration, reader.topics):
            print(f"{bag}: {told}")
        preamble = read_preamble(reader)
        if are_asked_for(configuration):
            preamble.labels = labels_in(reader, found.measurements or found.detections)
        prior = map_prior if map_prior is not None else find_map_prior(bag)
        digest = reader.sha256()
        if told := known_to_fit(configuration.semantic_model, digest):
            print(f"{bag}: {told}")
        source = source_text(bag, digest)
        inference = InferenceStage(configuration, prior, preamble, source, pool or InProcessPool(1))
        with BagWriter(out_bag) as writer:
            with noted_interrupts():  # it may import PyTorch, which an interrupt in its midst can abort
                run = OfflineRun(configuration, found, preamble, inference, writer)
            fault = _run(run, reader, max_keyframes)
    dropped = sum(run.dropped_by().values(), Counter[str]())
    if not run.num_keyframes:
        reasons = "; ".join(f"{reason} ({n})" for reason, n in sorted(dropped.items())) or "no detections in it"
        raise fault or InputError(f"{bag}: not one keyframe could be made: {reasons}; correct the bag's messages")
    return RunSummary(out_bag, run.num_frames, run.num_keyframes, dict(dropped), fault)


def _run(run: "OfflineRun", reader: BagReader, max_keyframes: int | None) -> InputError | None:
    """Process the bag up to its end, its damage or ``max_keyframes``; returns the error that ended it early."""
    with tqdm(total=run.num_expected(reader.counts), unit="frame", desc="frames") as progress:
        run.on_frame = progress.update
        run.max_keyframes = max_keyframes
        try:
            with noted_interrupts() as check_interrupts:
                fault = _feed(run, reader, check_interrupts)
        finally:
            run.conclude()
    return fault


def _feed(run: "OfflineRun", reader: BagReader, check_interrupts: Callable[[], None]) -> InputError | None:
    fault = None
    try:
        for message in reader.messages(run.wanted):
            check_interrupts()
            run.take(message, reader.decode)
            if run.is_done:
                break
    except InputError as error:
        fault = error
    try:
        run.finish()
    except InputError as error:
        fault = fault or error
    return fault


class OfflineRun:
    """Passes each message of a bag to the part that needs it, and each part's results to the next."""

    def __init__(
        self,
        configuration: Configuration,
        found: InputTopics,
        preamble: Preamble,
        inference: InferenceStage,
        writer: BagWriter,
    ) -> None:
        self.num_frames, self.num_keyframes = 0, 0
        self.on_frame: Callable[[], object] = lambda: None
        self.max_keyframes: int | None = None
        self._perception, self._found, self._preamble = configuration.perception, found, preamble
        self._inference, self._writer = inference, writer
        self._frames = FrameAssembler(
            configuration,
            has_depth=bool(found.depth),
            fixed_transforms=preamble.transforms if found.transforms else None,
        )
        self._imu = "" if unused_because(configuration) else found.imu
        self._keyframes = KeyframeAssembler(
            configuration,
            has_identities=bool(found.identities),
            imu=ImuSource(preamble.transforms) if self._imu else None,
        )
        self._copied = {*COPIED} if self._imu else {*COPIED} - {IMU}
        self._classifier = build_classifier(configuration) if found.has_images else None
        self._places = PlacesAssembler(configuration, self._camera_pose)
        self._camera_poses: dict[str, Array] = {}
        self._undecodable: Counter[str] = Counter()
        self._handlers = self._make_handlers(configuration)
        self._last_stamp_ns = 0

    def _make_handlers(self, configuration: Configuration) -> dict[str, Callable[[Any], None]]:
        found = self._found
        handlers: dict[str, Callable[[Any], None]] = {found.odometry: self._keyframes.add_odometry}
        if self._imu:
            handlers[self._imu] = self._keyframes.add_imu
        if found.has_images:
            handlers |= {
                found.image: self._frames.add_image,
                found.camera_info: self._frames.add_camera_info,
                found.detections: self._frames.add_detections,
            }
            if found.transforms:
                handlers[found.transforms] = self._frames.add_transforms
            if found.depth:
                handlers[found.depth] = self._frames.add_depth
        elif not found.has_places_alone:
            handlers[found.measurements] = lambda message: self._add_measurements(from_message(message))
        else:
            handlers[found.detections] = self._places.add_detections
            if found.camera_info:
                handlers[found.camera_info] = self._places.add_camera_info
        if found.identities and strategy_of(configuration).wants_identities:
            handlers[found.identities] = lambda message: self._keyframes.add_identities(from_message(message))
        return handlers

    @property
    def wanted(self) -> set[str]:
        """Topics to read from the bag."""
        return {*self._handlers, *self._copied}

    @property
    def is_done(self) -> bool:
        return self.max_keyframes is not None and self.num_keyframes >= self.max_keyframes

    def num_expected(self, counts: Counter[str]) -> int:
        """Expected number of frames, for the progress bar."""
        return counts[self._found.measurements or self._found.detections]

    def dropped_by(self) -> dict[str, Counter[str]]:
        """Counts of inputs not used and hypotheses dropped, by part and reason."""
        classifier = self._classifier.dropped if self._classifier else Counter[str]()
        return {
            "bag": self._undecodable,
            "frames": self._frames.dropped,
            "places": self._places.dropped,
            "classifier": classifier,
            "keyframes": self._keyframes.dropped,
            "hypotheses": self._inference.lost,
        }

    def take(self, message: RawMessage, decode: Callable[[bytes, str], Any]) -> None:
        """Process one message of the bag. Raises InputError if the run cannot continue."""
        self._last_stamp_ns = message.stamp_ns
        if message.topic in self._copied:
            self._writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns)
        if message.topic not in self._handlers:
            return
        try:
            content = decode(message.cdr, message.type_name)
        except InputError:
            self._undecodable[f"{message.topic}: message does not decode"] += 1
            return
        try:
            self._handlers[message.topic](content)
        except MessageError as fault:
            self._undecodable[f"{message.topic}: {fault.kind}"] += 1
            return
        self._measure(self._frames.take())
        self._pass_on(self._places.take())
        self._infer(self._keyframes.take())

    def finish(self) -> None:
        """Process everything that still waits for later messages. Raises InputError."""
        self._measure(self._frames.flush())
        self._pass_on(self._places.flush())
        self._infer(self._keyframes.flush())

    def conclude(self) -> None:
        """Write the views of the last belief and a diagnostics message with the dropped counts."""
        self._inference.finish(self._writer)
        stamp_ns = self._last_stamp_ns
        self._writer.write(topics.DIAGNOSTICS, dropped_message(stamp_ns, self.dropped_by()), stamp_ns)

    def _measure(self, frames: list[Frame]) -> None:
        for frame in frames:
            if self._classifier is None or self.is_done:
                return
            T_base_camera = frame.T_base_camera
            if T_base_camera is None:
                T_base_camera = self._camera_pose(frame.camera.frame_id)
            measured = self._classifier.measure(frame, self.num_frames, T_base_camera)
            dropped = self._frames.dropped.total() + self._classifier.dropped.total()
            self._add_measurements(replace(measured, dropped=dropped))

    def _camera_pose(self, optical_frame: str) -> Array:
        if optical_frame not in self._camera_poses:  # cached: all static transforms were read before the run
            extrinsics, base_frame = self._perception.extrinsics, self._perception.base_frame
            pose = sensor_pose(extrinsics, base_frame, self._preamble.transforms, optical_frame)
            self._camera_poses[optical_frame] = pose
        return self._camera_poses[optical_frame]

    def _pass_on(self, measured: list[SemanticMeasurements]) -> None:
        for measurements in measured:
            if not self.is_done:
                self._add_measurements(replace(measurements, dropped=self._places.dropped.total()))

    def _add_measurements(self, measurements: SemanticMeasurements) -> None:
        self.num_frames += 1
        self._writer.write(topics.MEASUREMENTS, measurements, measurements.stamp_ns)
        self._keyframes.add_measurements(measurements)
        self.on_frame()

    def _infer(self, keyframes: list[Keyframe]) -> None:
        for keyframe in keyframes:
            if not self.is_done:
                self._inference.process(keyframe, self._writer)
                self.num_keyframes += 1

"""Offline pipeline: computes a belief bag from an input bag in this process, or in a few that share the work.

bag -> FrontEnd -> Engine -> belief bag; the nodes use the same parts.
"""

from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import astuple, dataclass, replace
from pathlib import Path

from tqdm import tqdm

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import IN_A_MISSING_FILE, BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.building import check_run
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import BackendPool
from semantic_slam.inference.relocation.carried_spans import Spans
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.interrupts import noted_interrupts
from semantic_slam.messages import topics
from semantic_slam.pipeline.detector_labels import are_asked_for, known_to_fit, labels_in
from semantic_slam.pipeline.diagnostics import dropped_message
from semantic_slam.pipeline.front_end import FrontEnd, Reading, ReadingOrder
from semantic_slam.pipeline.front_end_process import FrontEndProcess
from semantic_slam.pipeline.gravity.imu_use import left_out
from semantic_slam.pipeline.idle_parameters import idle_parameters
from semantic_slam.pipeline.inference_stage import InferenceStage
from semantic_slam.pipeline.input_topics import InputTopics, find_topics
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
    carried: Spans = ()  # keyframes in which the robot was taken for carried elsewhere


def run_bag(
    bag: str | Path,
    out_bag: str | Path,
    configuration: Configuration,
    map_prior: MapPrior | None = None,
    max_keyframes: int | None = None,
    pool: BackendPool | None = None,
    *,
    reads_ahead: bool = False,
) -> RunSummary:
    """Run the pipeline on ``bag``, writing the belief bag ``out_bag`` incrementally.

    ``map_prior`` None: the objects.json beside the bag, if there is one. ``pool`` None: a new pool with one backend in
    this process; pass one to inspect its backends afterwards, or a ``ProcessPool`` to use more cores. ``reads_ahead``:
    a process beside this one reads and perceives, and what is written is the same, bit for bit. Raises InputError if
    not a single keyframe can be made; invalid input after the first keyframe ends the run and is returned in the
    summary.
    """
    if max_keyframes is not None and max_keyframes < 1:
        raise InputError(f"max_keyframes is {max_keyframes}; give 1 or more, or None for the whole bag")
    bag, out_bag = Path(bag), Path(out_bag)
    if out_bag.resolve() in (bag.resolve(), bag.resolve().parent):
        raise InputError(f"{out_bag}: is the input bag; name another output")
    with BagReader(bag) as reader, ExitStack() as stack:
        prior = map_prior if map_prior is not None else find_map_prior(bag)
        order = ReadingOrder(bag, configuration, *_looked_through(bag, reader, configuration, prior), max_keyframes)
        digest = reader.sha256()
        if told := known_to_fit(configuration.semantic_model, digest):
            print(f"{bag}: {told}")
        source = source_text(bag, digest)
        inference = InferenceStage(configuration, prior, order.preamble, source, pool or InProcessPool(1))
        with noted_interrupts():  # inside a constructor of C++, one that is raised may abort the process
            front = stack.enter_context(FrontEndProcess(order)) if reads_ahead else FrontEnd(order, reader)
        with BagWriter(out_bag) as writer:
            run = OfflineRun(inference, writer, MissingInputs.of(reader, order.found))
            _run(run, front, reader.counts[order.found.measurements or order.found.detections])
    dropped = sum(run.dropped_by.values(), Counter[str]())
    if not run.num_keyframes:
        reasons = "; ".join(f"{reason} ({n})" for reason, n in sorted(dropped.items())) or "no detections in it"
        remedy = "correct the bag's messages, or the configuration: semantic_slam doctor says which, and how"
        raise run.fault or InputError(f"{bag}: not one keyframe could be made: {reasons}; {remedy}")
    return RunSummary(out_bag, run.num_frames, run.num_keyframes, dict(dropped), run.fault, inference.carried)


def _looked_through(
    bag: Path, reader: BagReader, configuration: Configuration, prior: MapPrior | None
) -> tuple[InputTopics, Preamble]:
    """What must be known of a bag before the first keyframe; prints what is left out. Raises InputError."""
    found = find_topics(bag, reader.topics)
    reader.check_definitions()
    check_run(configuration, prior)  # here, as the first keyframe may be minutes of reading away
    if found.has_places_alone:
        depth = f"; {found.depth} is not used without" if found.depth else ""
        print(f"{bag}: no {topics.IMAGE}; {topics.DETECTIONS} are used by the places that they tell{depth}")
    for idle in idle_parameters(configuration):
        print(f"{bag}: {idle.line}")
    if told := left_out(configuration, reader.topics):
        print(f"{bag}: {told}")
    preamble = read_preamble(reader)
    if preamble.late_pose:
        print(f"{bag}: {preamble.late_pose}")
    if are_asked_for(configuration):
        preamble.labels = labels_in(reader, found.measurements or found.detections)
    return found, preamble


@dataclass(frozen=True)
class MissingInputs:
    """What a bag lacks for want of storage files that are missing."""

    counts: Counter[str]  # messages of a robot's topics that are read, by reason
    by_ns: int | None  # least log time of what lies behind the first of them; None: nothing does
    notice: str

    @classmethod
    def of(cls, reader: BagReader, found: InputTopics) -> "MissingInputs":
        names, read = {absolute(topic): topic for topic in topics.TYPES}, set(astuple(replace(found, identities="")))
        missing = {topic: number for topic, number in reader.missing.items() if topic in read}
        counts = Counter({f"{names[topic]}: {IN_A_MISSING_FILE}": number for topic, number in missing.items()})
        return cls(counts, reader.missing_by_ns, reader.missing_notice)

    def concern(self, reading: Reading) -> bool:
        """Whether a run came to what is missing: it read the bag to its end, or something that lies behind."""
        has_passed = self.by_ns is not None and reading.last_stamp_ns >= self.by_ns
        return bool(self.counts) and (reading.fault is not None or has_passed)


def _run(run: "OfflineRun", front: FrontEnd | FrontEndProcess, num_frames: int) -> None:
    """Process the bag up to its end, its damage or the last keyframe."""
    with tqdm(total=num_frames, unit="frame", desc="frames") as progress:
        run.on_frame = progress.update
        try:
            with noted_interrupts() as check_interrupts:
                front.read(run, check_interrupts)
        finally:
            run.conclude(front.reading)


class OfflineRun:
    """Takes what a front end makes of a bag: writes it, and has the keyframes inferred."""

    def __init__(self, inference: InferenceStage, writer: BagWriter, missing: MissingInputs) -> None:
        self.num_frames, self.num_keyframes = 0, 0
        self.on_frame: Callable[[], object] = lambda: None
        self.dropped_by: dict[str, Counter[str]] = {}
        self.fault: InputError | None = None
        self._inference, self._writer, self._missing = inference, writer, missing

    def copy(self, message: RawMessage) -> None:
        """Write a message as it is."""
        self._writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns)

    def measured(self, message: RawMessage) -> None:
        """Write the measurements of a frame."""
        self.num_frames += 1
        self.copy(message)
        self.on_frame()

    def keyframe(self, keyframe: Keyframe) -> None:
        """Infer a keyframe and write its belief. Raises InputError if the run cannot go on."""
        self._inference.process(keyframe, self._writer)
        self.num_keyframes += 1

    def say(self, line: str) -> None:
        """Print a line above the bar of progress."""
        tqdm.write(line)

    def conclude(self, reading: Reading | None) -> None:
        """Write the views of the last belief and, if it is known, what was dropped, as a diagnostics message."""
        self._inference.finish(self._writer)
        if reading is None:
            return
        self.fault, stamp_ns = reading.fault, reading.last_stamp_ns
        self.dropped_by = {**reading.dropped_by, "hypotheses": self._inference.lost}
        if self._missing.concern(reading):
            self.dropped_by["bag"] = reading.dropped_by["bag"] + self._missing.counts
            if self.fault is None:
                self.say(self._missing.notice)
        told = dropped_message(stamp_ns, self.dropped_by, self._inference.carried)
        self._writer.write(topics.DIAGNOSTICS, told, stamp_ns)

"""How much of a keyframe a detector's words take: reading and weighing them, in a room without a map."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from semantic_slam.configuration import (
    Configuration,
    OpenWorldConfiguration,
    SemanticModelConfiguration,
    load_configuration,
)
from semantic_slam.inference.building import initial_pose_of, make_run_configuration, problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.semantics.interface import SemanticEvidence, SemanticInput, Semantics
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.faulty_rooms.open_room import OpenRoom, open_room

KEYFRAMES, QUICK_KEYFRAMES = 80, 30
LABELS = tuple(f"label {number}" for number in range(80))
"""Labels, as many as those of detectors that know COCO."""
CONFUSED, SCORE, RUNNER_UP = 0.2, 0.6, 0.2
MOST = 0.05
"""Share of a keyframe's time that the requirement allows."""


class TimedSemantics:
    """Semantics, and the seconds of this thread that they take."""

    def __init__(self, semantics: Semantics) -> None:
        self._semantics, self.seconds = semantics, 0.0

    @classmethod
    def of(cls, models: object) -> "TimedSemantics":
        """No registry names the stop-watch."""
        raise NotImplementedError("the stop-watch is put around semantics")

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Weigh by the timed semantics; records are timed when they are made."""
        begin = time.thread_time()
        evidence = self._semantics.weigh(given)
        self.seconds += time.thread_time() - begin
        make = evidence.records

        def timed(rows: Sequence[int]) -> list[dict[int, ObjectViews]]:
            start = time.thread_time()
            found = make(rows)
            self.seconds += time.thread_time() - start
            return found

        return replace(evidence, records=timed)


def share(quick: bool, seed: int) -> list[Row]:
    """One row: seconds of the words, those of all keyframes, and their ratio."""
    count = QUICK_KEYFRAMES if quick else KEYFRAMES
    settings = Configuration(association="open", open_world=OpenWorldConfiguration(birth_density=0.1))
    random = keyed_generator("detector_share", seed)
    keyframes = _called(open_room(settings, count, random), random)
    shipped = load_configuration(configuration_file("detector"))
    own = replace(shipped, semantic_model=SemanticModelConfiguration(kind="detector", labels=LABELS))
    pose, covariance = initial_pose_of(own)
    run = make_run_configuration(own, None, pose, covariance, stamp_ns=0)
    problem = problem_of(run)
    watch = TimedSemantics(problem.semantics)
    watched = replace(problem, semantics=watch)
    engine = Engine.of_run(run, InProcessPool(1, watched), watched)
    begin = time.thread_time()
    for keyframe in keyframes:
        engine.process(keyframe)
    whole = time.thread_time() - begin
    how = (
        f"weighing the words of {len(LABELS)} labels, two scores a detection, and making their records, against whole"
        f" keyframes with them, in one run through an open room; at most {MOST} is asked for"
    )
    seconds = watch.seconds / count, whole / count
    return [
        Row("detector_keyframe_share", seconds[0] * 1e3, seconds[1] * 1e3, "ms", seconds[0] / seconds[1], count, how)
    ]


def _called(room: OpenRoom, random: np.random.Generator) -> list[Keyframe]:
    """The keyframes as a detector tells them: each object has a label, one box in five another."""
    every = []
    for keyframe, own in zip(room.keyframes, room.labels, strict=True):
        measured = keyframe.measurements
        scores = np.full((len(own), len(LABELS)), np.nan)
        words = [int(random.integers(len(LABELS))) if n < 0 or random.random() < CONFUSED else n % 5 for n in own]
        scores[np.arange(len(own)), [(word + 1) % len(LABELS) for word in words]] = RUNNER_UP
        scores[np.arange(len(own)), words] = SCORE
        told = replace(
            measured,
            class_names=LABELS,
            labels=tuple(LABELS[word] for word in words),
            class_scores=scores,
            class_probability_samples=np.zeros((len(own), 0, len(LABELS))),
            features=np.zeros((len(own), 0)),
            feature_covariances=np.zeros((len(own), 0, 0)),
        )
        every.append(replace(keyframe, measurements=told))
    return every

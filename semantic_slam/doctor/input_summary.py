"""Summary of an input (a bag, or a few seconds of a running system): the compact data used by all checks."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import Configuration
from semantic_slam.doctor.evidence import Evidence
from semantic_slam.doctor.innovations import Innovations
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.perception.frame import CameraModel
from semantic_slam.pipeline.input_topics import InputTopics
from semantic_slam.pipeline.preamble import Preamble

DISPARITIES = "disparities"
"""Encoding that is noted of a DisparityImage."""
LARGEST_OVERLAP = 0.7
"""Largest intersection over union of two boxes of one label that non-maximum suppression usually leaves."""


@dataclass(frozen=True)
class Stamps:
    """Header stamps and arrival times of one topic's messages, in order of arrival."""

    header_ns: NDArray[np.int64]  # (N,)
    arrival_ns: NDArray[np.int64]  # (N,)

    def __len__(self) -> int:
        return len(self.header_ns)

    @property
    def usual_step_s(self) -> float:
        """Median time from message to message [s]."""
        return float(np.median(np.abs(np.diff(self.header_ns)))) / NANOSECONDS

    def distances_s(self, others: "Stamps") -> Array:
        """(N,) from each stamp to the nearest one of at least two others."""
        times = np.sort(others.header_ns)
        at = np.clip(np.searchsorted(times, self.header_ns), 1, len(times) - 1)
        apart = np.minimum(np.abs(self.header_ns - times[at - 1]), np.abs(self.header_ns - times[at]))
        return np.asarray(apart / NANOSECONDS)


NO_STAMPS = Stamps(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


@dataclass(kw_only=True)
class DetectionRecord:
    """Properties of N detections from ``num_messages`` messages."""

    num_messages: int = 0
    boxes: Array = field(default_factory=lambda: np.zeros((0, 4)))  # (N, 4) pixels, NaN: no box
    scores: Array = field(default_factory=lambda: np.zeros(0))  # (N,)
    labels: Counter[str] = field(default_factory=Counter)  # of detections
    told_labels: frozenset[str] = frozenset()  # those and the names of class scores
    frame_ids: Counter[str] = field(default_factory=Counter)  # of messages
    frames_of_boxes: Counter[str] = field(default_factory=Counter)  # of messages with boxes
    num_doubled: int = 0  # of them those with two boxes of one label that overlap by more than LARGEST_OVERLAP
    has_embeddings: bool = False


@dataclass(kw_only=True)
class PictureRecord:
    """Properties of the images of a topic."""

    sizes: Counter[tuple[int, int]] = field(default_factory=Counter)  # (width, height)
    encodings: Counter[str] = field(default_factory=Counter)
    medians_m: list[float] = field(default_factory=list)  # of depth as its encoding says it


@dataclass(kw_only=True)
class ImuRecord:
    """Readings of an IMU, in its own frame."""

    frame_id: str = ""  # of the newest message; "": none was looked at
    num_messages: int = 0
    ups: list[Array] = field(default_factory=list)  # (3,) by orientations that are stated
    accelerations: list[Array] = field(default_factory=list)  # (3,) [m/s^2]


@dataclass(kw_only=True)
class InputSummary:
    """Summary of an input for the checks. Topics have absolute names."""

    configuration: Configuration
    prior: MapPrior | None
    types: Mapping[str, str]
    counts: Mapping[str, int]
    found: InputTopics
    preamble: Preamble
    is_live: bool = False
    stamps: dict[str, Stamps] = field(default_factory=dict)
    odometry_frames: Counter[tuple[str, str]] = field(default_factory=Counter)  # frame, child frame
    detections: DetectionRecord = field(default_factory=DetectionRecord)
    images: PictureRecord = field(default_factory=PictureRecord)
    depths: PictureRecord = field(default_factory=PictureRecord)
    imu: ImuRecord = field(default_factory=ImuRecord)
    picture_bytes: dict[str, int] = field(default_factory=dict)  # of the newest picture of each topic, as sent
    camera: CameraModel | None = None
    camera_poses: list[Array] = field(default_factory=list)  # (7,) T_base_camera of frames
    num_frames: int = 0  # detection messages that the first part of the pipeline was shown
    keyframes: list[Keyframe] = field(default_factory=list)  # what it made of them
    odometry: Array = field(default_factory=lambda: np.zeros((0, 4)))  # (N, 4) time [s], x, y, yaw until then
    dropped: Counter[str] = field(default_factory=Counter)  # and what it did not use, by reason
    faults: list[str] = field(default_factory=list)  # what it stumbled over

    def stamps_of(self, topic: str) -> Stamps:
        """Stamps of a topic that may not be there."""
        return self.stamps.get(topic, NO_STAMPS)

    @property
    def measured(self) -> str:
        """The topic whose messages become keyframes."""
        return self.found.measurements or self.found.detections

    @cached_property
    def evidence(self) -> Evidence:
        """What detections and odometry say of each other."""
        return Evidence.of(Innovations.of(self.keyframes, self.odometry, self.configuration))

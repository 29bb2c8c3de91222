"""Check of lost raw images: larger than the shared memory of a default Fast DDS writer."""

from collections.abc import Iterator

from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.messages import topics
from semantic_slam.messages.topics import TYPES

NAME = "raw pictures"
KEPT_BYTES = 512 * 1024
"""Default shared memory of a Fast DDS writer, in bytes."""
NEAR = 0.5
"""What is stamped farther from any picture than this share of the usual step is of one that has not come."""
SOME, MOST = 0.05, 0.5


def check(summary: InputSummary) -> Iterator[Finding]:
    for topic in (summary.found.image, summary.found.depth):
        if not are_lost(summary, topic):
            continue
        num_lost, num_taken = _counts(summary, topic)
        yield Finding(
            Severity.ERROR if num_lost > MOST * num_taken else Severity.WARNING,
            NAME,
            f"{topic}: {num_lost} of {num_taken} pictures of {summary.picture_bytes[topic] / 1e3:.0f} kB have not come;"
            f" stock Fast DDS keeps {KEPT_BYTES // 1024} KiB for a writer, and at best effort the rest is lost",
            "start what publishes them with FASTRTPS_DEFAULT_PROFILES_FILE set to our config/fastdds_pictures.xml, or"
            " publish them compressed (docs/ros.md, raw pictures)",
        )


def are_lost(summary: InputSummary, topic: str) -> bool:
    """Whether pictures of a running system do not come that are too large for their writer."""
    is_large = summary.picture_bytes.get(topic, 0) > KEPT_BYTES
    if not (summary.is_live and is_large and summary.types[topic] == TYPES[topics.IMAGE]):
        return False
    num_lost, num_taken = _counts(summary, topic)
    return num_lost > SOME * num_taken


def _counts(summary: InputSummary, topic: str) -> tuple[int, int]:
    """How many pictures have not come, and how many were taken: a camera's driver sends intrinsics with each."""
    pictures, told = summary.stamps_of(topic), summary.stamps_of(summary.found.camera_info)
    if min(len(pictures), len(told)) < 2:
        return 0, 0
    since_the_first = told.header_ns >= pictures.header_ns.min()
    lost = told.distances_s(pictures) > NEAR * told.usual_step_s
    return int((lost & since_the_first).sum()), int(since_the_first.sum())

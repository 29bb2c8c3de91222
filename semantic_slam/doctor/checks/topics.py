"""Check of topics: missing, silent, of another type, or under another name."""

from collections.abc import Iterator

from semantic_slam.bag.names import absolute
from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.messages import topics
from semantic_slam.messages.topics import TYPES
from semantic_slam.pipeline.gravity.imu_use import NAME as TOPIC
from semantic_slam.pipeline.gravity.imu_use import TYPE, unused_because
from semantic_slam.pipeline.input_topics import lacking, mistyped

NAME = "topics"
NAMED_SO = (topics.IMAGE_COMPRESSED, topics.IMAGE, topics.DETECTIONS)
"""Topics of which one under another name is worth a word; of types that little else has."""


def check(summary: InputSummary) -> Iterator[Finding]:
    wrong = mistyped(summary.types)
    for topic, kind in wrong.items():
        ours = next(TYPES[name] for name in TYPES if absolute(name) == topic)
        yield error(NAME, f"{topic} is {kind}, not {ours}", _retyped(summary, topic))
    for topic in lacking(summary.found):
        if absolute(topic) not in wrong:
            yield error(NAME, f"no topic {topic} ({TYPES[topic]}){_alike(summary, topic)}", _renamed(summary, topic))
    yield from _silent(summary)
    if TOPIC not in summary.types and not unused_because(summary.configuration):
        yield from _imu_elsewhere(summary)
    if not summary.found.image:
        yield from _pictures_elsewhere(summary)
        yield from _idle_depth(summary)


def _silent(summary: InputSummary) -> Iterator[Finding]:
    found = summary.found
    imu = "" if unused_because(summary.configuration) else found.imu
    for topic in (found.odometry, summary.measured, found.camera_info, found.image, found.depth, imu):
        if topic and not summary.counts.get(topic, 0):
            yield error(
                NAME,
                f"{topic} is there and has no message",
                "start what publishes it" if summary.is_live else "record it again with its publisher running",
            )


def _pictures_elsewhere(summary: InputSummary) -> Iterator[Finding]:
    alike = [topic for name in NAMED_SO[:2] for topic in _of_type(summary, TYPES[name])]
    alike = [topic for topic in alike if "depth" not in topic]
    if alike and not summary.found.measurements:
        what = f"{', '.join(alike[:3])}: pictures that nobody reads; detections are used without"
        yield warning(NAME, what, _renamed(summary, topics.IMAGE))


def _idle_depth(summary: InputSummary) -> Iterator[Finding]:
    """Depth of boxes, which is read where there are pictures alone."""
    if summary.found.depth and summary.found.has_places_alone and summary.detections.frames_of_boxes.total():
        what = f"{summary.found.depth} is not used, as there are no pictures: boxes are bearings alone"
        yield warning(NAME, what, f"publish or record colour pictures, too, as {topics.IMAGE}")


def _imu_elsewhere(summary: InputSummary) -> Iterator[Finding]:
    if alike := _of_type(summary, TYPE):
        what = f"{', '.join(alike[:3])}: inertial sensors that nobody reads; roll and pitch go by odometry alone"
        yield warning(NAME, what, _renamed(summary, topics.IMU))


def _alike(summary: InputSummary, topic: str) -> str:
    others = _of_type(summary, TYPES[topic])
    return f", but {', '.join(others[:3])} of that type" if others else ""


def _of_type(summary: InputSummary, kind: str) -> list[str]:
    """Topics of a type that no name of ours stands for."""
    ours = {absolute(topic) for topic in TYPES}
    return sorted(topic for topic, found in summary.types.items() if found == kind and topic not in ours)


def _renamed(summary: InputSummary, topic: str) -> str:
    by_tf = topic == topics.ODOMETRY and topics.TF in summary.types
    if summary.is_live:
        remedy = f"start its publisher, or remap it: -r {topic}:=/your/topic"
        return f"{remedy}; where it comes by /tf alone, run tf_odometry_node" if by_tf else remedy
    remedy = "record it, or have semantic_slam import bag take it under the name that it has"
    return f"{remedy}; where it is on /tf alone, with --odom /tf" if by_tf else remedy


def _retyped(summary: InputSummary, topic: str) -> str:
    if summary.is_live:
        return f"publish the type that is read, or remap another topic to it: -r {topic[1:]}:=/your/topic"
    return "semantic_slam import bag converts other types"

"""Frame ids of odometry and detections."""

from collections.abc import Iterator

from semantic_slam.doctor.finding import Finding, Severity, error
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.messages.sensor import plain_frame
from semantic_slam.pipeline.assembly.body_places import ELSEWHERE

NAME = "frames"
MANY = 0.5


def check(summary: InputSummary) -> Iterator[Finding]:
    yield from _odometry(summary)
    yield from _detections(summary)
    yield from _places(summary)


def _odometry(summary: InputSummary) -> Iterator[Finding]:
    base, topic = plain_frame(summary.configuration.perception.base_frame), summary.found.odometry
    for (frame, child), count in summary.odometry_frames.items():
        seen = f"{count} of {summary.odometry_frames.total()} messages of {topic}"
        if child not in ("", base):
            is_swapped = frame == base
            remedy = (
                "exchange header.frame_id (odom) and child_frame_id (the robot's body)"
                if is_swapped
                else f"set perception.base_frame: {child}, if that is the robot's body, or publish that of '{base}'"
            )
            yield error(
                NAME, f"{seen} are of '{child}' where perception.base_frame is '{base}', and are not used", remedy
            )
        elif frame and frame in (child, base):
            yield error(
                NAME,
                f"{seen} give the pose of '{child or base}' in '{frame}', which is the robot itself",
                "name the frame in which poses accumulate in header.frame_id: odom",
            )


def _detections(summary: InputSummary) -> Iterator[Finding]:
    """Boxes of another camera; beside positions they may be of the body's frame, too."""
    camera, seen = summary.camera, summary.detections
    if camera is None:
        return
    expected = plain_frame(camera.frame_id)
    right, frames = {expected}, seen.frame_ids
    if not summary.found.has_images:
        right, frames = {expected, plain_frame(summary.configuration.perception.base_frame)}, seen.frames_of_boxes
    for frame, count in frames.items():
        if count and frame not in right:
            yield Finding(
                Severity.ERROR if count > MANY * seen.num_messages else Severity.WARNING,
                NAME,
                f"{count} of {seen.num_messages} messages of {summary.found.detections} are of '{frame}' and the camera"
                f" is '{expected}'",
                "have the detector copy the image's header",
            )


def _places(summary: InputSummary) -> Iterator[Finding]:
    """Positions that cannot be moved to the body; what is left would count as misses of what they show."""
    for reason, count in summary.dropped.items():
        if reason.startswith(ELSEWHERE):
            what, _, remedy = reason.partition("; ")
            yield error(
                NAME, f"{what} ({count} of the first {summary.num_frames} messages, which are not used)", remedy
            )

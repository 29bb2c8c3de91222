"""Check of inputs dropped by the pipeline in the first frames, as far as no other check explains them."""

from collections.abc import Iterator

from semantic_slam.doctor.finding import Finding, Severity, error, of_fault, warning
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.inertial import FAULTS
from semantic_slam.perception.places import BAD_COVARIANCE, BAD_RANGE, NO_PLACE

NAME = "dropped"
SOME, MOST = 0.1, 0.9
"""Per detection message; what is wrong with messages of topic imu themselves, per message of it."""
OF_IMU_MESSAGES = tuple(f"{topics.IMU}: {fault}" for fault in FAULTS)
SAID_ELSEWHERE = (
    "time goes backwards", "leaps ahead", "set back", "stamp repeats", "of their stamp", "at their stamp",
    "none of the detections' stamp", "half of it lies", "size ", "frame id", "of frame", "unknown label", "box ",
    "no static transforms", "/tf from", "same outline", "come to gravity", "contradict",
    "jumps farther", "scores outside 0..1",
)  # fmt: skip
NO_CAMERA = f"no {topics.CAMERA_INFO} came"
REMEDIES = {
    NO_CAMERA: "publish camera_info, or name it: semantic_slam import bag --camera-info",
    "arrays of different lengths": "fill all arrays of DetectionArray with one row a detection",
    "does not decode": "record it with the definitions that its publisher has",
    "not finite": "correct its publisher",
    NO_PLACE: "give boxes with a camera_info and its transform, or positions, or ranges and bearings",
    BAD_RANGE: "give ranges in metres, above zero, and NaN for none",
    "orientation that is no rotation": (
        "give a quaternion of norm 1, or say -1 in orientation_covariance[0] where there is none (REP 145)"
    ),
    "nor accelerations": "publish what the accelerometer shows, or an orientation (REP 145)",
    "imu.window_s before": "record imu and odom at their full rates, from the start to the end of the drive",
    "just before imu": "start the sensor before the detections, as frames of up to 5 s before it are left out",
    "robot accelerates": "gravity is felt where the robot moves steadily; publish an orientation to have it everywhere",
    BAD_COVARIANCE: "give variances above zero, or NaN where they are not known",
}


def check(summary: InputSummary) -> Iterator[Finding]:
    for text in summary.faults:
        if not any(words in text for words in SAID_ELSEWHERE):
            yield of_fault(NAME, InputError(text))
    refused = any(text.startswith(f"{topics.CAMERA_INFO}: ") for text in summary.faults)  # one came, and is no camera
    told = (*SAID_ELSEWHERE, NO_CAMERA) if refused else SAID_ELSEWHERE
    for reason, count in sorted(summary.dropped.items()):
        num, what = summary.num_frames, "detection messages"
        if reason in OF_IMU_MESSAGES:
            num, what = summary.imu.num_messages, f"messages of {topics.IMU}"
        share = count / max(num, 1)
        if share > SOME and not any(words in reason for words in told):
            yield Finding(
                Severity.ERROR if share > MOST else Severity.WARNING,
                NAME,
                f"{reason} ({count} in the first {num} {what})".replace(";", ","),
                next((remedy for words, remedy in REMEDIES.items() if words in reason), "see docs/troubleshooting.md"),
            )


def check_last(summary: InputSummary, found: list[Finding]) -> Iterator[Finding]:
    """Report that no keyframe was made, where no earlier finding explains it."""
    if summary.keyframes or any(each.severity == Severity.ERROR for each in found):
        return
    if not len(summary.detections.scores) and not summary.dropped:
        yield _nothing_seen(summary)
        return
    reasons = ", ".join(f"{reason} ({count})" for reason, count in sorted(summary.dropped.items()))
    yield error(
        NAME,
        f"not one keyframe could be made of {summary.num_frames} detection messages ({reasons})",
        "see docs/troubleshooting.md",
    )


def _nothing_seen(summary: InputSummary) -> Finding:
    """No detection, where the configuration makes keyframes of detections alone: a whole bag without is no input."""
    num_messages = summary.detections.num_messages
    what = f"no detection in {num_messages} messages of {summary.measured or 'detections'}"
    if summary.is_live or num_messages < summary.counts.get(summary.measured, 0):
        return warning(NAME, what, "have something in view that the detector knows")
    return error(NAME, f"{what}, so no keyframe", "record something that the detector knows, or correct the detector")

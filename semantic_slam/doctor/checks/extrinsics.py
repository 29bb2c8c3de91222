"""Check of extrinsics: missing transforms, and cameras with a wrong orientation."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.messages.sensor import plain_frame, sensor_pose

NAME = "extrinsics"
STEEP = np.sin(np.radians(60.0))
UPRIGHT = 0.3
"""Smallest plausible z component of a camera's up direction in the body frame."""
FARTHEST_M = 10.0
"""Largest plausible distance [m] of a camera from the robot's origin."""
OPTICAL = (
    "give the pose of the optical frame (z forward, x right, y down; for a camera that looks ahead the quaternion"
    " -0.5 0.5 -0.5 0.5), in /tf_static or perception.extrinsics"
)


def check(summary: InputSummary) -> Iterator[Finding]:
    yield from _missing(summary)
    evidence = summary.evidence
    if evidence.turn:
        yield error(
            NAME,
            f"detections agree with odometry {1.0 / evidence.ratio:.1f} times better {_turned(evidence.turn)}",
            OPTICAL if summary.camera_poses else "give bearings counter-clockwise from straight ahead (REP-103)",
        )
    if summary.camera_poses:
        poses = np.array(summary.camera_poses)
        yield from _direction(poses[len(poses) // 2], is_seen_wrong=bool(evidence.turn))


def _turned(turn: str) -> str:
    if turn == "mirrored":
        return "with left and right exchanged"
    return f"if their sensor looks {turn} of where it is told to"


def _missing(summary: InputSummary) -> Iterator[Finding]:
    camera, settings = summary.camera, summary.configuration.perception
    if camera is None or summary.camera_poses or not summary.num_frames or not summary.found.has_images:
        return
    try:
        sensor_pose(settings.extrinsics, settings.base_frame, summary.preamble.transforms, camera.frame_id)
    except InputError:
        known = ", ".join(summary.preamble.transforms.frames) or "none"
        yield error(
            NAME,
            f"no transform from '{settings.base_frame}' to the camera '{plain_frame(camera.frame_id)}'; frames of"
            f" /tf_static: {known}".replace(";", ","),
            "publish /tf_static, set perception.extrinsics, or perception.base_frame to the robot's frame",
        )


def _direction(T_base_camera: Array, *, is_seen_wrong: bool) -> Iterator[Finding]:
    """``is_seen_wrong``: the drive has told so already."""
    rotation = rotation_matrix(T_base_camera[3:])
    forward, upward = rotation[:, 2], -rotation[:, 1]
    if forward[2] > STEEP:
        yield error(NAME, f"the camera looks up ({_degrees(forward[2]):.0f} deg above the horizon)", OPTICAL)
    elif not is_seen_wrong and forward[0] < -STEEP:
        yield warning(NAME, "the camera looks backwards", f"{OPTICAL}; of a rear camera this is right")
    elif abs(forward[2]) < STEEP and upward[2] < UPRIGHT:
        lies = "upside down" if upward[2] < -UPRIGHT else "on its side"
        yield warning(NAME, f"the camera is {lies}", f"{OPTICAL}; of a camera that is mounted so this is right")
    distance_m = float(np.linalg.norm(T_base_camera[:3]))
    if distance_m > FARTHEST_M:
        yield error(NAME, f"the camera is {distance_m:.4g} m away from the robot's origin", "give metres")


def _degrees(sine: float) -> float:
    return float(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))

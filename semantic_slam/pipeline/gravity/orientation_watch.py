"""Tells once that orientations of topic imu contradict the accelerations of its own messages."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from semantic_slam.configuration import ImuConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.inertial import ImuReading
from semantic_slam.pipeline.gravity.imu_look import ImuLook, NoLookError, look_by_accelerations
from semantic_slam.pipeline.gravity.imu_window import ImuWindow

DISAGREE_RAD = np.radians(20.0)
"""Tolerated angle between up from orientations and up from mean accelerations."""
SIGMAS = 2.5
"""Tolerated in standard deviations that the orientations state, where these are wider."""
ENOUGH = 3
"""Keyframes in succession whose windows contradict."""
REMEDY = "give orientations in a world with z up, along the axes of header.frame_id"


class OrientationWatch:
    """Compares orientations with mean accelerations of the same messages, where the robot hardly accelerates."""

    STATE: ClassVar[tuple[str, ...]] = ("_num_apart", "_is_told", "_news")

    def __init__(self, settings: ImuConfiguration) -> None:
        self._settings = settings
        self._num_apart, self._is_told = 0, False
        self._news: list[str] = []

    def compare(self, look: ImuLook, readings: Sequence[tuple[int, ImuReading]], window: ImuWindow) -> None:
        """Compare what a keyframe uses with the accelerations of its window, if these come to gravity."""
        if self._is_told or all(reading.up is None for _, reading in readings):
            return
        try:
            felt = look_by_accelerations(readings, window, self._settings, is_first=False)
        except NoLookError:
            return
        apart = angle_between(look.up, felt.up)
        tolerated = max(DISAGREE_RAD, SIGMAS * np.sqrt(look.variance))
        self._num_apart = self._num_apart + 1 if apart > tolerated else 0
        if self._num_apart == ENOUGH:
            self._is_told = True
            self._news.append(
                f"{contradiction(topics.IMU, apart)}, and it is what counts; {REMEDY}, or -1 as first entry of"
                " orientation_covariance, so that accelerations count"
            )

    def news(self) -> list[str]:
        """The line, once."""
        told, self._news = self._news, []
        return told


def contradiction(topic: str, apart_rad: float) -> str:
    """What is wrong with a topic whose orientations and accelerations are that far apart."""
    return f"{topic}: up by its orientation is {np.degrees(apart_rad):.0f} deg off up by its accelerations"


def angle_between(a: Array, b: Array) -> float:
    """Angle [rad] between two directions (3,) of any length."""
    lengths = max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)
    return float(np.arccos(np.clip(a @ b / lengths, -1.0, 1.0)))

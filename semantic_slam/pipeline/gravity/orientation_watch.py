"""Decides what counts where orientations of topic imu contradict its accelerations, and tells what is wrong with it."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from semantic_slam.configuration import ImuConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.inertial import ImuReading
from semantic_slam.pipeline.gravity.imu_look import ImuLook, NoLookError, look_by_accelerations
from semantic_slam.pipeline.gravity.imu_window import ImuWindow
from semantic_slam.pipeline.gravity.up_fault import SHOWS, UPSIDE_DOWN_RAD, angle_between, off_z, up_fault

DISAGREE_RAD = np.radians(20.0)
"""Tolerated angle between up from orientations and up from mean accelerations."""
SIGMAS = 2.5
"""Tolerated in standard deviations of both, where these are wider."""
ENOUGH = 3
"""Keyframes in succession that contradict, after which orientations count no more: wrong ones may agree by chance."""
REMEDY = "give orientations in a world with z up, along the axes of header.frame_id"


class OrientationWatch:
    """Compares orientations with mean accelerations of the same messages, and up with the body's z axis.

    ``faults`` are what was found, each told once.
    """

    STATE: ClassVar[tuple[str, ...]] = ("faults", "_has_looked", "_num_told", "_num_apart")

    def __init__(self, settings: ImuConfiguration) -> None:
        self._settings = settings
        self.faults: list[str] = []
        self._has_looked, self._num_told, self._num_apart = False, 0, 0

    def trusted(self, look: ImuLook, readings: Sequence[tuple[int, ImuReading]], window: ImuWindow) -> ImuLook:
        """What a keyframe is to use: by accelerations where orientations contradict them, or did so often.

        Raises NoLookError where these are upside down, as either may be wrong, or of no use.
        """
        used = self._of_both(look, readings, window)
        is_first, self._has_looked = not self._has_looked, True
        what, remedy = up_fault(topics.IMU, used.up)
        if what and (is_first or off_z(used.up) > UPSIDE_DOWN_RAD):
            self._tell("up is along", f"{what}; {remedy}")
        return used

    def news(self) -> list[str]:
        """Lines on new faults."""
        told, self._num_told = self.faults[self._num_told :], len(self.faults)
        return told

    def _of_both(self, look: ImuLook, readings: Sequence[tuple[int, ImuReading]], window: ImuWindow) -> ImuLook:
        if all(reading.up is None for _, reading in readings):
            return look
        if self._num_apart >= ENOUGH:
            return look_by_accelerations(readings, window, self._settings, is_first=not self._has_looked)
        try:
            felt = look_by_accelerations(readings, window, self._settings, is_first=not self._has_looked)
        except NoLookError:
            if self._num_apart:
                raise
            return look
        apart = angle_between(look.up, felt.up)
        if apart <= max(DISAGREE_RAD, SIGMAS * np.sqrt(look.variance + felt.variance)):
            self._num_apart = 0
            return look
        is_upside_down = off_z(felt.up) > UPSIDE_DOWN_RAD
        counts = "and neither counts, as these are upside down" if is_upside_down else "and these count"
        self._tell(
            "up by its",
            f"{contradiction(topics.IMU, apart)}, {counts}; {REMEDY}, or -1 as first entry of"
            f" orientation_covariance; {SHOWS}",
        )
        if is_upside_down:
            raise NoLookError("orientation contradicts accelerations, which are upside down")
        self._num_apart += 1
        return felt

    def _tell(self, kind: str, line: str) -> None:
        if not any(kind in told for told in self.faults):
            self.faults.append(line)


def contradiction(topic: str, apart_rad: float) -> str:
    """What is wrong with a topic whose orientations and accelerations are that far apart."""
    return f"{topic}: up by its orientation is {np.degrees(apart_rad):.0f} deg off up by its accelerations"

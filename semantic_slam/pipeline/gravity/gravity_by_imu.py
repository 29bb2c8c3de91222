"""Gravity direction (roll and pitch) at keyframes, measured by topic imu.

The start pose of a run takes roll and pitch from the measurement in its first keyframe (``start_of``). Without it they
are unknown until a later keyframe has one, so that a run does not start shortly before the first IMU message.
"""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.inertial import ImuReading, imu_reading
from semantic_slam.messages.sensor import TransformTree, sensor_pose
from semantic_slam.messages.standard import NANOSECONDS, header_stamp_ns, is_pose
from semantic_slam.pipeline.gravity.imu_look import ImuLook, NoLookError, look_of
from semantic_slam.pipeline.gravity.imu_use import ANY_TILT_RAD
from semantic_slam.pipeline.gravity.imu_window import ImuWindow
from semantic_slam.pipeline.gravity.level import repeated
from semantic_slam.pipeline.gravity.orientation_watch import OrientationWatch
from semantic_slam.pipeline.odometry.odometry_path import OdometryPath
from semantic_slam.pipeline.stamps.stamped_buffer import StampedBuffer
from semantic_slam.reasons import count, quoted

SILENT_NS = 2 * NANOSECONDS
"""Lag behind odometry, or advance of odometry without a message, above which the topic counts as silent."""
MOST_BEHIND_NS = 30 * NANOSECONDS
"""Lag of the stamps behind odometry above which, live, messages are not in a queue, but have another clock."""
START_NS = 5 * NANOSECONDS
"""Longest delay, by stamps, of a run's start for the first message and, live, for the transform to its frame."""
OPEN = (
    f"unless {topics.INITIAL_POSE} tells them, roll and pitch are known to {ANY_TILT_RAD} rad until a later keyframe"
    " measures them"
)


@dataclass(frozen=True)
class ImuSource:
    """An IMU that a run uses."""

    transforms: TransformTree  # of /tf_static; may still grow
    waits: bool = True  # wait for its messages, however late; False, live: keyframes do without a silent IMU


class GravityByImu:
    """Buffers IMU readings and measures gravity at keyframes; ``dropped`` counts, by reason, what was not used."""

    STATE: ClassVar[tuple[str, ...]] = (
        "_readings",
        "_last_look_ns",
        "_has_begun",
        "_wanted_ns",
        "_watch",
        "_news",
        "_heard_ns",
        "_least_lag_ns",
    )

    def __init__(self, configuration: Configuration, source: ImuSource, dropped: Counter[str]) -> None:
        """Raises InputError for invalid extrinsics."""
        self._settings, self._source, self._dropped = configuration.imu, source, dropped
        self._repeats_s = configuration.odometry.level_repeats_s
        self._base_frame = configuration.perception.base_frame
        if self._settings.extrinsics:
            self._pose("")
        self._readings: StampedBuffer[ImuReading] = StampedBuffer(topics.IMU, dropped)
        self._watch = OrientationWatch(configuration.imu)
        self._last_look_ns: int | None = None
        self._news: list[str] = []
        self._heard_ns: int | None = None  # newest odometry stamp when the topic's newest message came
        self._least_lag_ns: int | None = None  # of a message's stamp behind the odometry that had come before it
        self._has_begun = False
        self._wanted_ns: int | None = None  # stamp of the first measurements that were to become a keyframe
        self.window_ns = round(configuration.imu.window_s * NANOSECONDS)

    def add(self, message: Any, newest_odometry_ns: int | None = None) -> None:
        """Take a sensor_msgs/Imu, at the odometry that has come so far; None: there is none."""
        reading = imu_reading(message)
        if reading.fault:
            self._dropped[f"{topics.IMU}: {reading.fault}"] += 1
        before_ns = self._readings.last_stamp_ns
        self._readings.add(header_stamp_ns(message), reading)
        last_ns = self._readings.last_stamp_ns
        if last_ns is None or last_ns == before_ns:
            return
        self._heard_ns = newest_odometry_ns
        if newest_odometry_ns is not None:
            lag_ns = newest_odometry_ns - last_ns
            self._least_lag_ns = lag_ns if self._least_lag_ns is None else min(lag_ns, self._least_lag_ns)

    def is_known(self, stamp_ns: int, newest_odometry_ns: int) -> bool:
        """Whether all readings up to an instant have arrived, or, live, are not waited for any longer.

        Live, odometry may be ahead only because messages of this topic are more and queue. The topic counts as
        silent by how far odometry has advanced since its last message came, unless it lags too far to be in a queue, or
        has always lagged, as that is another clock.
        """
        if self._readings.has_reached(stamp_ns):
            return True
        patience_ns = SILENT_NS if self._has_begun else START_NS
        since_ns = max(stamp_ns, self._queued_until_ns(newest_odometry_ns))
        return not self._source.waits and newest_odometry_ns - since_ns > patience_ns

    def _queued_until_ns(self, newest_odometry_ns: int) -> int:
        """Newest odometry stamp up to which the topic was heard; 0: never, or it lags too far behind."""
        last_ns, least_ns = self._readings.last_stamp_ns, self._least_lag_ns
        if last_ns is None or self._heard_ns is None or least_ns is None or least_ns > SILENT_NS:
            return 0
        return self._heard_ns if newest_odometry_ns - last_ns <= MOST_BEHIND_NS else 0

    def is_silent(self, newest_odometry_ns: int) -> bool:
        """Whether the topic lags behind odometry by more than ``SILENT_NS``."""
        return not self._readings.has_reached(newest_odometry_ns - SILENT_NS)

    def begins_later(self, stamp_ns: int) -> bool:
        """Whether to delay the start of the run past this instant, because roll and pitch can be measured soon."""
        if self._has_begun or not len(self._readings):
            return False
        self._wanted_ns = stamp_ns if self._wanted_ns is None else self._wanted_ns
        first_ns, reading = self._readings.first()
        if first_ns > stamp_ns:
            return first_ns - self._wanted_ns <= START_NS
        may_come = not self._source.waits and stamp_ns - self._wanted_ns <= START_NS
        return may_come and not self._is_placed(reading.frame_id)

    def release(self) -> None:
        """Accept readings on hold, as no more will come."""
        self._readings.release()

    def go_on_from(self, former: "GravityByImu") -> None:
        """Take the readings of this session that the object of the previous one has refused."""
        self._readings.go_on_from(former._readings)

    def forget_before(self, stamp_ns: int) -> None:
        """Remove the readings that no keyframe after this instant needs."""
        self._readings.forget_before(stamp_ns - self.window_ns)

    @property
    def faults(self) -> list[str]:
        """What is wrong with what the topic tells, so far."""
        return self._watch.faults

    def news(self) -> list[str]:
        """Lines on a first keyframe without a measurement, and on :attr:`faults`, once."""
        told, self._news = self._news, []
        return [*told, *self._watch.news()]

    def level_at(self, stamp_ns: int, path: OdometryPath) -> Array | None:
        """(4,) ``Keyframe.level`` at a keyframe, with odometry's ``path`` up to it; None, counted, if not measured."""
        is_first, self._has_begun = not self._has_begun, True
        try:
            look = self._look(stamp_ns, path)
        except NoLookError as reason:
            count(self._dropped, f"{topics.IMU}: {reason}")
            if is_first:
                self._news.append(f"{topics.IMU} tells nothing at the first keyframe ({reason}); {OPEN}")
            return None
        elapsed_s = np.inf if self._last_look_ns is None else (stamp_ns - self._last_look_ns) / NANOSECONDS
        self._last_look_ns = stamp_ns
        return np.append(look.up, repeated(look.variance, elapsed_s, self._repeats_s))

    def _look(self, stamp_ns: int, path: OdometryPath) -> ImuLook:
        found = [item for item in self._readings if stamp_ns - self.window_ns < item[0] <= stamp_ns]
        if not found:
            raise NoLookError("no message within imu.window_s before a keyframe")
        frame_id = found[-1][1].frame_id
        readings = [item for item in found if item[1].frame_id == frame_id]
        window = ImuWindow(stamp_ns, self.window_ns, self._pose_of(frame_id), path)
        look = look_of(readings, window, self._settings, is_first=self._last_look_ns is None)
        used = self._watch.trusted(look, readings, window)
        if used is not look:
            count(
                self._dropped, f"{topics.IMU}: orientation that contradicts accelerations, or did, so that these count"
            )
        return used

    def _is_placed(self, frame_id: str) -> bool:
        """Whether the sensor's pose in the body frame is known."""
        with suppress(InputError):
            self._pose(frame_id)
            return True
        return False

    def _pose_of(self, frame_id: str) -> Array:
        """(7,) T_body_imu. Raises NoLookError."""
        try:
            pose = self._pose(frame_id)
        except InputError:
            named = f"no static transforms from {self._base_frame} to {quoted(frame_id)}"
            raise NoLookError(f"{named}, publish /tf_static or set imu.extrinsics") from None
        if not is_pose(pose):
            raise NoLookError("the transform to its frame is not finite")
        return se3.wrapped(pose)

    def _pose(self, frame_id: str) -> Array:
        settings, tree = self._settings, self._source.transforms
        return sensor_pose(settings.extrinsics, self._base_frame, tree, frame_id, "imu.extrinsics")

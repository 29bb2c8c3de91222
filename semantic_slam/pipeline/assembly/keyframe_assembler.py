"""Assembles odometry and semantic measurements, which arrive in any order, into keyframes in stamp order.

The result depends on the messages' stamps alone. A measurement becomes a keyframe, or is skipped by the policy, once
odometry has reached its stamp; for the first keyframe, once odometry's first stamps are confirmed, too. The stamps of
keyframes increase: after the first one, measurements that agree on an earlier time are another session.

Policies: ``every_detection`` makes a keyframe of every measurement with detections and, in an open world, where missed
detections are evidence, also of those without. ``odometry`` makes one of the first measurement and of every one, with
or without detections, at which the robot has moved far enough since the last keyframe. The odometry of a keyframe
includes the motion since the previous keyframe, over skipped measurements.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration, OdometryConfiguration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import between
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.clock_offset import OFFSETS
from semantic_slam.inference.open_world.planar.region import is_left_out
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations
from semantic_slam.messages.sensor import odometry_sample, plain_frame
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.perception.best_scored import best_scored
from semantic_slam.perception.boxes.box_tracks import BoxTracks
from semantic_slam.perception.boxes.same_outline import joined
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.usable_measurements import usable, with_scores
from semantic_slam.pipeline.assembly.points_input import PointsInput
from semantic_slam.pipeline.assembly.region_watch import RegionWatch
from semantic_slam.pipeline.gravity.gravity_by_imu import GravityByImu, ImuSource
from semantic_slam.pipeline.gravity.imu_use import unused_because
from semantic_slam.pipeline.gravity.level import level_at
from semantic_slam.pipeline.odometry.motion import (
    OdometryPoint,
    motion_covariance,
    motion_covariance_in_space,
    motion_shifts,
    motion_slopes,
)
from semantic_slam.pipeline.odometry.odometry_buffer import OdometryBuffer
from semantic_slam.pipeline.stamps.stamped_buffer import StampedBuffer
from semantic_slam.reasons import count, quoted


class KeyframeAssembler:
    """Selects the measurements that become keyframes and adds odometry; ``dropped`` counts unused ones by reason."""

    STATE: ClassVar[tuple[str, ...]] = (
        "dropped",
        "policy",
        "_tracks",
        "_watch",
        "_odometry",
        "_measurements",
        "_identities",
        "_last_keyframe",
        "_last_poses",
        "_last_driven",
        "_imu",
        "_next_index",
        "is_paused",
    )

    def __init__(
        self,
        configuration: Configuration,
        has_identities: bool = False,
        passes_over: Callable[[SemanticMeasurements], bool] = lambda _: False,
        imu: ImuSource | None = None,
    ) -> None:
        """``has_identities``: with ``association: given``, object ids are supplied by :meth:`add_identities`.

        ``passes_over``: returns whether measurements must not become a keyframe, which is counted. ``imu``: source of
        the readings passed to :meth:`add_imu`, used only if the configuration needs it; None: there is no IMU.
        """
        self.dropped: Counter[str] = Counter()
        self._configuration = configuration
        self.policy = configuration.keyframes  # may be replaced during a run
        self._association = strategy_of(configuration)
        self._are_labels_read = class_model_kind(configuration.semantic_model).labels is not None
        self._has_identities, self._passes_over = has_identities, passes_over
        self._tracks = BoxTracks() if tracks_tell(configuration) else None
        self._in_space = PointsInput(configuration, self.dropped) if configuration.is_spatial else None
        self._world = configuration.open_world
        self._watch = RegionWatch(configuration)
        self._odometry = OdometryBuffer(self.dropped, with_slopes=configuration.odometry.estimate_bias)
        self._measurements: StampedBuffer[SemanticMeasurements] = StampedBuffer(topics.MEASUREMENTS, self.dropped)
        self._identities: StampedBuffer[tuple[str, ...]] = StampedBuffer(topics.GROUND_TRUTH_ASSOCIATIONS, self.dropped)
        self._last_keyframe: OdometryPoint | None = None
        self._last_poses: Array | None = None  # (G, 7) odometry there at all clock offsets, if these are estimated
        self._last_driven: tuple[float, float] | None = None  # [m], [rad] up to there, by uncorrected odometry stamps
        self._expected_ns = round(configuration.odometry.clock_offset_s * NANOSECONDS)
        self._offsets_ns = _offsets_ns(configuration.odometry)
        self._instants_ns = [0, -self._expected_ns, *self._offsets_ns]  # odometry is evaluated at stamp + each of these
        self._imu = (
            GravityByImu(configuration, imu, self.dropped) if imu and not unused_because(configuration) else None
        )
        if self._imu is not None:
            self._instants_ns.append(-self._imu.window_ns)
        self._next_index = 0
        self.is_paused = False  # make no keyframes; the next one's odometry includes the motion meanwhile

    @property
    def first_pose(self) -> Array | None:
        """(7,) T_odom_body where the motion of the first keyframe starts; None before the first odometry."""
        return None if self._odometry.start is None else self._odometry.start.pose

    def add_odometry(self, message: Any) -> None:
        """Take a nav_msgs/Odometry; one that is not finite is dropped, and its neighbours are interpolated."""
        try:
            sample = odometry_sample(message, topics.ODOMETRY)
        except InputError:
            self.dropped[f"{topics.ODOMETRY}: pose is not finite"] += 1
            return
        child, base = plain_frame(message.child_frame_id), plain_frame(self._configuration.perception.base_frame)
        if child not in ("", base):
            reason = f"{topics.ODOMETRY}: of frame {quoted(child)}, where perception.base_frame is '{base}'"
            count(self.dropped, reason)
            return
        stamp_ns = sample.stamp_ns - self._expected_ns
        stated = None if self._in_space is None else sample.covariance
        self._odometry.add(stamp_ns, replace(sample, stamp_ns=stamp_ns, covariance=stated))

    def add_imu(self, message: Any) -> None:
        """Take a sensor_msgs/Imu; ignored if the configuration does not use it."""
        if self._imu is not None:
            self._imu.add(message, self._odometry.last_stamp_ns)

    def add_measurements(self, measurements: SemanticMeasurements) -> None:
        """Take the measurements of one frame; detections that are no valid measurements are dropped, as such scores."""
        told = usable(measurements, topics.MEASUREMENTS, self.dropped)
        told = with_scores(told, topics.MEASUREMENTS, self.dropped, of_classes=self._are_labels_read)
        if self._in_space is not None:
            told = self._in_space.usable(told)
        settings = self._configuration.perception
        rows, prefix = np.arange(len(told)), f"{topics.MEASUREMENTS}: "
        best = best_scored(rows, told.scores, settings.max_detections, self.dropped, prefix)
        told = told if len(best) == len(told) else told.take(best)
        found = joined(told, self._configuration)
        if num_joined := len(told) - len(found):
            self.dropped[f"{topics.MEASUREMENTS}: joined to one with the same outline or place"] += num_joined
        self._measurements.add(measurements.stamp_ns, found)

    def add_identities(self, identities: GroundTruthAssociations) -> None:
        """Take the object ids of the detections of one frame, used with ``association: given``."""
        self._identities.add(identities.stamp_ns, identities.object_ids)

    def news(self) -> list[str]:
        """Lines for the console, each once."""
        told = [*self._odometry.news(), *self._watch.news()]
        return told if self._imu is None else [*told, *self._imu.news()]

    @property
    def imu_faults(self) -> list[str]:
        """What is wrong with what topic imu tells, so far."""
        return [] if self._imu is None else self._imu.faults

    @property
    def num_waiting(self) -> int:
        """Number of measurements that wait for odometry, identities or IMU; 0 while a suspicious stamp is on hold.

        Otherwise a lossless replay would wait for them and not send the message that decides on the held one. It is
        also 0 while the first stamps of odometry are not confirmed, and while the IMU is silent.
        """
        is_held = self._odometry.is_holding or self._identities.is_holding or not self._odometry.is_settled
        is_held = is_held or self._is_imu_silent
        return 0 if is_held else len(self._measurements)

    @property
    def _is_imu_silent(self) -> bool:
        newest_ns = self._odometry.last_stamp_ns
        return self._imu is not None and newest_ns is not None and self._imu.is_silent(newest_ns)

    @property
    def is_over(self) -> bool:
        """Whether odometry and measurements both restarted from an earlier time, so that another session has begun."""
        return self._odometry.begins_again and self._measurements.begins_again

    def go_on_from(self, former: "KeyframeAssembler") -> None:
        """Take the messages of this session that the assembler of the previous one has refused."""
        self._odometry.go_on_from(former._odometry)
        self._measurements.go_on_from(former._measurements)
        self._identities.go_on_from(former._identities)
        if self._imu is not None and former._imu is not None:
            self._imu.go_on_from(former._imu)

    def take(self) -> list[Keyframe]:
        """Keyframes that are complete, in stamp order. Raises InputError if required object ids cannot be supplied."""
        return self._keyframes(at_end=False)

    def flush(self) -> list[Keyframe]:
        """All remaining keyframes, once no more messages will come; see ``MAX_EXTRAPOLATION_S``."""
        for buffer in (self._odometry, self._measurements, self._identities):
            buffer.release()
        if self._imu is not None:
            self._imu.release()
        return self._keyframes(at_end=True)

    def _keyframes(self, at_end: bool) -> list[Keyframe]:
        keyframes = []
        while len(self._measurements):
            stamp_ns, measurements = self._measurements.first()
            if not at_end and not self._is_all_known(measurements):
                break
            self._measurements.pop()
            keyframe = self._keyframe(measurements if self._tracks is None else self._tracks.named(measurements))
            if keyframe is not None:
                keyframes.append(keyframe)
            if self._imu is not None:
                self._imu.forget_before(stamp_ns)
        return keyframes

    def _is_all_known(self, measurements: SemanticMeasurements) -> bool:
        """Whether all messages that a keyframe of these measurements depends on have arrived."""
        stamp_ns = measurements.stamp_ns
        return (
            self._odometry_known(stamp_ns) and self._identities_known(measurements) and self._is_gravity_known(stamp_ns)
        )

    def _odometry_known(self, stamp_ns: int) -> bool:
        """Whether all odometry that the motion to this stamp depends on has arrived, and will not be withdrawn."""
        return self._odometry.is_settled and self._odometry.has_reached(stamp_ns + max(self._instants_ns))

    def _is_gravity_known(self, stamp_ns: int) -> bool:
        newest_ns = self._odometry.last_stamp_ns
        return self._imu is None or (newest_ns is not None and self._imu.is_known(stamp_ns, newest_ns))

    def _identities_known(self, measurements: SemanticMeasurements) -> bool:
        return not self._needs_identities(measurements) or self._identities.has_reached(measurements.stamp_ns)

    def _needs_identities(self, measurements: SemanticMeasurements) -> bool:
        """Whether detections need identities from another topic; raises InputError if there is no such topic."""
        if not self._association.wants_identities or not len(measurements) or any(measurements.track_ids):
            return False
        if not self._has_identities:
            raise InputError(
                f"association: given, but the {topics.DETECTIONS} carry no track_ids and there is no"
                f" {topics.GROUND_TRUTH_ASSOCIATIONS}; set association: enumerated, or open"
            )
        return True

    def _keyframe(self, measurements: SemanticMeasurements) -> Keyframe | None:
        """The next keyframe; None if the policy skips the measurement or, counted, if it cannot be used."""
        if not self._is_odometry_near(measurements.stamp_ns):
            self.dropped[f"{topics.MEASUREMENTS}: no {topics.ODOMETRY} at their stamp"] += 1
            return None
        if self.is_paused:
            self.dropped[f"{topics.MEASUREMENTS}: came while the robot was paused"] += 1
            return None
        driven = self._odometry.driven_at(measurements.stamp_ns - self._expected_ns)
        if not self._is_chosen(measurements, driven):
            return None
        if self._imu is not None and self._imu.begins_later(measurements.stamp_ns):
            self.dropped[f"{topics.MEASUREMENTS}: just before {topics.IMU} is heard, with which the run begins"] += 1
            return None
        measurements = self._inside(measurements)
        if self._passes_over(measurements):
            self.dropped[f"{topics.MEASUREMENTS}: no label named so far"] += 1
            return None
        named = self._with_identities(measurements)
        if named is None:
            self.dropped[f"{topics.MEASUREMENTS}: no {topics.GROUND_TRUTH_ASSOCIATIONS} of their stamp"] += 1
            return None
        point, last = self._odometry.at(measurements.stamp_ns), self._last_keyframe or self._odometry.start
        assert last is not None
        level = self._level(point)
        covariance = motion_covariance if self._in_space is None else motion_covariance_in_space
        keyframe = Keyframe(
            index=self._next_index,
            stamp_ns=measurements.stamp_ns,
            odometry=between(last.pose, point.pose),
            odometry_covariance=covariance(last, point, self._configuration.odometry),
            measurements=named,
            odometry_slopes=motion_slopes(last, point),
            odometry_shifts=self._shifts(last, point),
            level=level,
            is_level_to_come=level is None and self._imu is not None,
        )
        self._measurements.settle()
        self._next_index += 1
        self._last_keyframe, self._last_driven = point, driven
        return keyframe

    def _is_odometry_near(self, stamp_ns: int) -> bool:
        """Whether there is odometry at an instant, or shortly before or after it; prunes what is older than needed."""
        oldest, _ = self._odometry.around(stamp_ns + min(self._instants_ns))
        if oldest is not None:
            self._odometry.forget_before(oldest.stamp_ns)
        return self._odometry.is_near(stamp_ns)

    def _level(self, point: OdometryPoint) -> Array | None:
        """``Keyframe.level`` of a 3D run, from the IMU or from odometry; None if neither measures it."""
        if self._in_space is None:
            return None
        if self._imu is not None:
            return self._imu.level_at(point.stamp_ns, self._odometry.path_to(point))
        return level_at(point, self._last_keyframe, self._configuration.odometry)

    def _shifts(self, last: OdometryPoint, point: OdometryPoint) -> Array | None:
        """Changes of the motion by odometry clock offsets; None if the offset is not estimated."""
        if not self._offsets_ns:
            return None
        poses = np.array([self._odometry.standing_at(point.stamp_ns + each_ns).pose for each_ns in self._offsets_ns])
        before = self._last_poses if self._last_poses is not None else np.tile(last.pose, (len(poses), 1))
        self._last_poses = poses
        return motion_shifts(before, poses)

    def _is_chosen(self, measurements: SemanticMeasurements, driven: tuple[float, float]) -> bool:
        """Whether the policy selects the frame; ``driven`` does not depend on the configured odometry clock offset."""
        policy, last = self.policy, self._last_driven
        if policy.policy == "every_detection":
            return len(measurements) > 0 or self._association.counts_misses
        return last is None or driven[0] - last[0] >= policy.distance_m or driven[1] - last[1] >= policy.angle_rad

    def _inside(self, measurements: SemanticMeasurements) -> SemanticMeasurements:
        """Without detections outside the open world's region, or beyond the range up to which it is learned.

        Outside it new objects could not be distinguished from known ones.
        """
        if not self._association.counts_misses:
            return measurements
        if self._in_space is not None and not self._world.learn_region:
            outside = self._in_space.outside(measurements)
        else:
            outside = is_left_out(measurements.ranges_m, measurements.bearings_rad, self._world)
        self._watch.count(len(outside), int(outside.sum()))
        if not outside.any():
            return measurements
        self.dropped[f"{topics.MEASUREMENTS}: detections outside the region of open_world"] += int(outside.sum())
        return measurements.take(np.flatnonzero(~outside))

    def _with_identities(self, measurements: SemanticMeasurements) -> SemanticMeasurements | None:
        """The measurements, with supplied object ids as track ids if needed; None if these are missing."""
        if not self._needs_identities(measurements):
            return measurements
        object_ids = self._identities.nearest(measurements.stamp_ns, 0)
        self._identities.forget_before(measurements.stamp_ns)
        if object_ids is None or max(measurements.detection_ids) >= len(object_ids):
            return None
        return replace(measurements, track_ids=tuple(object_ids[index] for index in measurements.detection_ids))


def tracks_tell(configuration: Configuration) -> bool:
    """Whether boxes are tracked from frame to frame: if tracks are evidence for the data association."""
    return configuration.open_world.track_error_share > 0.0 and configuration.association == "open"


def _offsets_ns(odometry: OdometryConfiguration) -> list[int]:
    """Odometry clock offsets [ns] at which motions are evaluated; empty if the offset is not estimated."""
    if not odometry.estimate_bias or odometry.sigma_clock_offset_s <= 0.0:
        return []
    return [round(offset * odometry.sigma_clock_offset_s * NANOSECONDS) for offset in OFFSETS]

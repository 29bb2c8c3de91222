"""Check of the IMU: wrong type, missing transform, a wrong up direction, and keyframes without a measurement."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import ImuRecord, InputSummary
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.messages import topics
from semantic_slam.messages.inertial import GRAVITY_M_S2
from semantic_slam.messages.sensor import sensor_pose
from semantic_slam.pipeline.gravity.imu_look import NO_GRAVITY
from semantic_slam.pipeline.gravity.imu_use import ANY_TILT_RAD, TYPE, unused_because
from semantic_slam.pipeline.gravity.imu_use import NAME as TOPIC
from semantic_slam.pipeline.gravity.orientation_watch import DISAGREE_RAD, REMEDY, contradiction
from semantic_slam.pipeline.gravity.up_fault import MOUNT, SHOWS, UPSIDE_DOWN_RAD, angle_between, off_z, up_fault

NAME = "imu"
MOST_OFF_M_S2 = 1.5
"""Tolerated difference [m/s^2] of the mean acceleration of a recording from gravity."""
LEAST_M_S2 = 3.0
"""Mean acceleration [m/s^2] below which gravity has been removed."""
JOLTED = 0.1
"""Part of the keyframes whose accelerations may be no gravity."""
EARLY = "so have the sensor run at rest for a second before the first detections, or tell /initialpose"


def check(summary: InputSummary) -> Iterator[Finding]:
    found = list(_of_messages(summary))
    yield from found
    if not found:
        yield from _of_keyframes(summary)


def _of_messages(summary: InputSummary) -> Iterator[Finding]:
    if unused_because(summary.configuration):
        return
    kind = summary.types.get(TOPIC, TYPE)
    if kind != TYPE:
        yield error(
            NAME, f"{TOPIC} is {kind}, not {TYPE}", "remap another topic to it, or have import bag --imu take it"
        )
    if not summary.imu.frame_id:
        return
    yield from _accelerations(summary.imu)
    settings, base = summary.configuration.imu, summary.configuration.perception.base_frame
    try:
        pose = sensor_pose(settings.extrinsics, base, summary.preamble.transforms, summary.imu.frame_id)
    except InputError:
        known = ", ".join(summary.preamble.transforms.frames) or "none"
        what = f"no transform from '{base}' to '{summary.imu.frame_id}', frames of /tf_static: {known}"
        yield error(NAME, what, MOUNT)
        return
    yield from _up(summary.imu, rotation_matrix(pose[3:]))


def _of_keyframes(summary: InputSummary) -> Iterator[Finding]:
    """Whether keyframes have no measurement although nothing is wrong with the messages on average."""
    measured = [not keyframe.is_level_to_come for keyframe in summary.keyframes]
    if all(measured) or not summary.imu.num_messages:
        return
    counted = {reason: count for reason, count in summary.dropped.items() if reason.startswith(f"{topics.IMU}: ")}
    told = [f"{reason.removeprefix(f'{topics.IMU}: ')}: {count}" for reason, count in sorted(counted.items())]
    whole = f"of {len(measured)} keyframes ({'; '.join(told)})".replace(";", ",")
    jolted = sum(count for reason, count in counted.items() if NO_GRAVITY in reason)
    if not any(measured):
        what = f"{TOPIC} measures gravity at none {whole}"
        yield error(NAME, what, f"roll and pitch are known to {ANY_TILT_RAD} rad alone, {EARLY}")
    elif jolted > JOLTED * len(measured):
        what = f"{TOPIC} measures gravity at {sum(measured)} {whole}"
        yield warning(NAME, what, "mount the sensor where nothing jolts it, or publish an orientation")
    elif not measured[0] and not summary.is_live:
        what = f"{TOPIC} measures gravity at keyframe {measured.index(True)} first, {whole}"
        yield warning(NAME, what, f"until then roll and pitch are known to {ANY_TILT_RAD} rad alone, {EARLY}")


def _accelerations(record: ImuRecord) -> Iterator[Finding]:
    """Whether what is shown is gravity, and orientations agree."""
    if not record.accelerations:
        return
    mean = np.mean(record.accelerations, axis=0)
    length = float(np.linalg.norm(mean))
    if record.ups:
        apart = angle_between(mean, np.mean(record.ups, axis=0))
        if length > LEAST_M_S2 and apart > DISAGREE_RAD:
            yield error(NAME, contradiction(TOPIC, apart), f"{REMEDY}; {SHOWS}")
    elif length < LEAST_M_S2:
        what = f"{TOPIC}: accelerations come to {length:.2f} m/s^2 on average, without gravity or in units of it"
        yield error(NAME, what, f"give m/s^2, with gravity; {SHOWS}")
    elif abs(length - GRAVITY_M_S2) > MOST_OFF_M_S2:
        yield error(NAME, f"{TOPIC}: accelerations come to {length:.2f} m/s^2 on average", f"calibrate them; {SHOWS}")


def _up(record: ImuRecord, rotation: Array) -> Iterator[Finding]:
    """Whether up in the body is about where it should be."""
    told = record.ups or record.accelerations
    if not told or np.linalg.norm(mean := np.mean(told, axis=0)) == 0.0:
        return
    up = rotation @ mean / np.linalg.norm(mean)
    what, remedy = up_fault(TOPIC, up)
    if what:
        yield (error if off_z(up) > UPSIDE_DOWN_RAD else warning)(NAME, what, remedy)

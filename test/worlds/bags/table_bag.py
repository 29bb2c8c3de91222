"""A flight over tables as a bag: odometry in space, and positions of what a detector with depth found."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, TableTops
from semantic_slam_lab.studies.tables.run import configuration
from worlds.bags.bag_factory import Entry, static_transform, write_bag
from worlds.scenes.inertial import Imu, SmoothPath, imu_messages

from semantic_slam.configuration import Configuration, from_dict, to_dict
from semantic_slam.geometry import se3
from semantic_slam.inference.inputs.keyframe import SECOND_NS
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.perception.frame import Detections
from semantic_slam.pipeline.preamble import MAP_PRIOR_FILE

SLOW_S, TOLD_PER_STEP = 3.0, 30
"""Between keyframes of a camera that is carried as a hand does, and how often odometry is told meanwhile."""
ODOMETRY = {"sigma_translation_per_m": 0.02, "sigma_rotation_per_rad": 0.02, "sigma_translation_floor_m": 0.003}


def in_space() -> Configuration:
    """The study's, with where the camera is mounted."""
    values = to_dict(configuration())
    values["perception"]["extrinsics"] = T_BODY_CAMERA.tolist()
    values["odometry"] |= ODOMETRY
    return from_dict(values, "test")


def table_entries(room: TableTops, period_ns: int = SECOND_NS) -> list[Entry]:
    """Odometry from its own origin, the true poses, and detections, a keyframe every ``period_ns``."""
    entries, pose = list[Entry](), se3.exp(np.zeros(6))
    for keyframe, truth in zip(room.keyframes, room.truth, strict=True):
        stamp, measured = (keyframe.index + 1) * period_ns, keyframe.measurements
        pose = se3.compose(pose, keyframe.odometry)
        found = Detections(
            stamp_ns=stamp,
            frame_id="base_link",
            boxes=np.full((len(measured), 4), np.nan),
            labels=measured.labels,
            scores=measured.scores,
            track_ids=measured.track_ids,
            class_names=measured.class_names,
            class_scores=measured.class_scores,
            positions=measured.points,
            position_covariances=measured.point_covariances,
        )
        entries += [
            Entry(topics.ODOMETRY, to_message(_odometry(stamp, "odom", se3.wrapped(pose))), stamp),
            Entry(topics.GROUND_TRUTH_ODOMETRY, to_message(_odometry(stamp, "map", truth)), stamp),
            Entry(topics.DETECTIONS, to_message(found), stamp),
        ]
    return entries


def with_imu(room: TableTops, imu: Imu, random: np.random.Generator) -> list[Entry]:
    """:func:`table_entries`, slow enough for a hand, with topic imu and odometry that is told between keyframes.

    The transform of the sensor is on /tf_static; where map begins nothing says.
    """
    count = len(room.keyframes)
    times = SLOW_S * np.arange(1, count + 1)
    path = SmoothPath(times, room.truth)
    first = round(times[0] * SECOND_NS)
    entries = [Entry(topics.TF_STATIC, static_transform(first, imu.frame_id, imu.T_body_imu), first)]
    entries += [entry for entry in table_entries(room, round(SLOW_S * SECOND_NS)) if entry.topic != topics.ODOMETRY]
    for stamp, topic, message in imu_messages(path, imu, (times[0] - 0.5, times[-1] + 0.1), random):
        entries.append(Entry(topic, message, stamp))
    for stamp, pose in _odometry_between(room, path, times):
        entries.append(Entry(topics.ODOMETRY, to_message(_odometry(stamp, "odom", pose)), stamp))
    return sorted(entries, key=lambda entry: entry.stamp_ns)


def _odometry_between(room: TableTops, path: SmoothPath, times: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Stamps and poses ``TOLD_PER_STEP`` times a step, each of which errs more and more until its end."""
    pose = se3.exp(np.zeros(6))
    yield round(times[0] * SECOND_NS), pose
    for k in range(1, len(times)):
        told, before = room.keyframes[k].odometry, room.truth[k - 1]
        error = se3.log(se3.between(se3.between(before, room.truth[k]), told))
        for share in np.arange(1, TOLD_PER_STEP + 1) / TOLD_PER_STEP:
            time = times[k - 1] + share * SLOW_S
            (true,) = path.at(np.array([time]))
            step = se3.retract(se3.between(before, true), share * error)
            yield round(time * SECOND_NS), se3.wrapped(se3.compose(pose, step))
        pose = se3.compose(pose, told)


def write_table_bag(path: Path, entries: list[Entry]) -> Path:
    """The bag ``path`` of a flight, without a map."""
    write_bag(path, entries)
    (path / MAP_PRIOR_FILE).unlink()
    return path


def _odometry(stamp_ns: int, frame: str, pose: np.ndarray) -> OdometryEstimate:
    return OdometryEstimate(stamp_ns, frame, "base_link", pose, np.zeros((6, 6)))

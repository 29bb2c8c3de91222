"""A flight over tables as a bag: odometry in space, and positions of what a detector with depth found."""

from pathlib import Path

import numpy as np
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, TableTops
from semantic_slam_lab.studies.tables.run import configuration
from worlds.bag_factory import Entry, write_bag

from semantic_slam.configuration import Configuration, from_dict, to_dict
from semantic_slam.geometry import se3
from semantic_slam.inference.inputs.keyframe import SECOND_NS
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.perception.frame import Detections
from semantic_slam.pipeline.preamble import MAP_PRIOR_FILE

ODOMETRY = {"sigma_translation_per_m": 0.02, "sigma_rotation_per_rad": 0.02, "sigma_translation_floor_m": 0.003}


def in_space() -> Configuration:
    """The study's, with where the camera is mounted."""
    values = to_dict(configuration())
    values["perception"]["extrinsics"] = T_BODY_CAMERA.tolist()
    values["odometry"] |= ODOMETRY
    return from_dict(values, "test")


def table_entries(room: TableTops) -> list[Entry]:
    """Odometry from its own origin, the true poses, and detections."""
    entries, pose = list[Entry](), se3.exp(np.zeros(6))
    for keyframe, truth in zip(room.keyframes, room.truth, strict=True):
        stamp, measured = (keyframe.index + 1) * SECOND_NS, keyframe.measurements
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


def write_table_bag(path: Path, entries: list[Entry]) -> Path:
    """The bag ``path`` of a flight, without a map."""
    write_bag(path, entries)
    (path / MAP_PRIOR_FILE).unlink()
    return path


def _odometry(stamp_ns: int, frame: str, pose: np.ndarray) -> OdometryEstimate:
    return OdometryEstimate(stamp_ns, frame, "base_link", pose, np.zeros((6, 6)))

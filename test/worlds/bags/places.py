"""The small input bag without its pictures: what stands in the boxes told as places."""

from dataclasses import replace

import numpy as np
from worlds.bags.bag_factory import (
    OBJECTS,
    OPTICAL,
    SPEED_M,
    T_BASE_CAMERA,
    Entry,
    frame_stamp,
    input_entries,
    odometry,
    of_topic,
    static_transform,
)

from semantic_slam.geometry.transform import inverse
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.places import in_body_frame

NUM_FRAMES = 4


def relative_positions(k: int) -> np.ndarray:
    """(2, 3) positions of the two objects in the body frame at frame ``k``."""
    return OBJECTS - [SPEED_M * k, 0.0, 0.0]


def place_entries(told: str, num_frames: int = NUM_FRAMES, track_ids: tuple[str, ...] = ("", "")) -> list[Entry]:
    """Odometry, truth and detections with ``told`` "ranges" or "positions", and no camera."""
    entries, whole = [], input_entries(num_frames, with_depth=False)
    for topic in (topics.ODOMETRY, topics.GROUND_TRUTH_ODOMETRY, topics.GROUND_TRUTH_ASSOCIATIONS):
        entries += of_topic(whole, topic)
    for k in range(num_frames):
        found = _detections(frame_stamp(k), relative_positions(k), told, track_ids)
        entries.append(Entry(topics.DETECTIONS, to_message(found), frame_stamp(k)))
    return sorted(entries, key=lambda entry: entry.stamp_ns)


def told_by_sensor(entries: list[Entry], *, is_mounted: bool = True) -> list[Entry]:
    """Positions as the camera's frame has them; ``is_mounted``: /tf_static tells where on the body that is."""
    for entry in of_topic(entries, topics.DETECTIONS):
        entry.message = to_message(in_body_frame(from_message(entry.message), inverse(T_BASE_CAMERA), OPTICAL))
    start_ns = entries[0].stamp_ns
    mount = Entry(topics.TF_STATIC, static_transform(start_ns, OPTICAL, T_BASE_CAMERA), start_ns)
    return [mount, *entries] if is_mounted else entries


def _detections(stamp_ns: int, positions: np.ndarray, told: str, track_ids: tuple[str, ...]) -> Detections:
    x, y, z = positions.T
    ranges = {
        "ranges_m": np.linalg.norm(positions, axis=1),
        "bearings_rad": np.arctan2(y, x),
        "elevations_rad": np.arctan2(-z, np.hypot(x, y)),
    }
    return Detections(
        stamp_ns=stamp_ns,
        frame_id="base_link",
        boxes=np.full((len(positions), 4), np.nan),
        labels=("box",) * len(positions),
        scores=np.full(len(positions), 0.9),
        track_ids=track_ids,
        **(ranges if told == "ranges" else {"positions": positions}),
    )


def named_entries(things: dict[str, tuple[float, float]], num_frames: int) -> list[Entry]:
    """Odometry of the small bag and, in every frame, each of the things (x, y in map [m]) by its label and position."""
    entries = of_topic(input_entries(num_frames, with_depth=False), topics.ODOMETRY)
    places = np.array([[x, y, 0.0] for x, y in things.values()])
    for k in range(num_frames):
        seen = _detections(frame_stamp(k), places - [SPEED_M * k, 0.0, 0.0], "ranges", ("",) * len(things))
        entries.append(Entry(topics.DETECTIONS, to_message(replace(seen, labels=tuple(things))), frame_stamp(k)))
    return sorted(entries, key=lambda entry: entry.stamp_ns)


def entries_to_and_fro(num_frames: int, turns_after: int = 15) -> list[Entry]:
    """Odometry, and ranges of the two objects, of a robot that backs up after so many frames, and so on, for ever."""
    places = [SPEED_M * abs((k + turns_after) % (2 * turns_after) - turns_after) for k in range(num_frames)]
    entries = [Entry(topics.ODOMETRY, to_message(odometry(frame_stamp(-1), places[0])), frame_stamp(-1))]
    for k, x in enumerate(places):
        seen = _detections(frame_stamp(k), OBJECTS - [x, 0.0, 0.0], "ranges", ("", ""))
        entries.append(Entry(topics.ODOMETRY, to_message(odometry(frame_stamp(k), x)), frame_stamp(k)))
        entries.append(Entry(topics.DETECTIONS, to_message(seen), frame_stamp(k)))
    return entries

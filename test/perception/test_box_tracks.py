"""Boxes that follow one another from frame to frame have one track."""

from dataclasses import replace

import numpy as np

from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.perception.boxes.box_tracks import LONGEST_S, BoxTracks
from semantic_slam.perception.measurement import SemanticMeasurements

FRAME_S = 1.0 / 30.0
BOX = np.array([100.0, 100.0, 140.0, 150.0])
RIGHT = np.array([30.0, 0.0, 30.0, 0.0])
NOWHERE = np.full(4, np.nan)


def seen(time_s: float, *boxes: np.ndarray, **told: object) -> SemanticMeasurements:
    detections = [Detection(bearing_rad=0.1, range_m=1.0, label="cup") for _ in boxes]
    measured = Keyframe.planar(0, detections=detections).measurements
    return replace(measured, stamp_ns=round(time_s * 1e9), boxes=np.array(boxes).reshape(-1, 4), **told)


def followed(frames: list[SemanticMeasurements]) -> list[tuple[str, ...]]:
    tracks = BoxTracks()
    return [tracks.named(frame).track_ids for frame in frames]


def test_two_boxes_side_by_side_keep_their_tracks_in_whatever_order_they_come() -> None:
    left, right = BOX, BOX + RIGHT
    (one, other), *later = followed([seen(0.0, left, right), seen(FRAME_S, right, left), seen(2 * FRAME_S, left)])
    assert one != other and later == [(other, one), (one,)]


def test_what_moves_on_while_it_is_missed_is_found_where_it_went() -> None:
    """By eight pixels a frame, five times as far as the box is wide: it does not overlap with its last one."""
    at = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 20]
    named = followed([seen(n * FRAME_S, BOX + n * np.array([8.0, 0.0, 8.0, 0.0])) for n in at])
    assert len(set(named)) == 1


def test_a_track_does_not_wait_for_ever_and_no_other_box_goes_on_with_it() -> None:
    late = followed([seen(0.0, BOX), seen(1.1 * LONGEST_S, BOX)])
    beside = followed([seen(0.0, BOX), seen(FRAME_S, BOX + 3.0 * RIGHT)])
    assert late[0] != late[1] and beside[0] != beside[1]


def test_an_earlier_stamp_begins_anew() -> None:
    first, again = followed([seen(5.0, BOX), seen(1.0, BOX)])
    assert first != again


def test_a_tracker_s_own_tracks_count_and_what_has_no_box_has_no_track() -> None:
    tracks = BoxTracks()
    told = seen(0.0, BOX, track_ids=("mine",))
    assert tracks.named(told) is told
    assert tracks.named(seen(0.0, NOWHERE, BOX)).track_ids == ("", "1")
    assert tracks.named(seen(0.0)).track_ids == ()

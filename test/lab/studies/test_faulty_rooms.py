"""Rooms whose data or whose map are wrong, and how what is said of them is judged."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from semantic_slam_lab.studies.faulty_rooms.closed_room import SIGMA_MAP, make_room, with_map_known_to
from semantic_slam_lab.studies.faulty_rooms.existence import (
    Judged,
    _ghosts,
    calibration_error,
    configuration,
    reliability,
)
from semantic_slam_lab.studies.faulty_rooms.faults import FAULTS
from semantic_slam_lab.studies.faulty_rooms.knowable import moved_if_associations_were_known
from semantic_slam_lab.studies.faulty_rooms.open_room import FALSE_ALARM, open_room
from semantic_slam_lab.studies.faulty_rooms.study import run

from semantic_slam.geometry import se2


def _rooms(count: int, truth: float) -> list[Judged]:
    """Each with 20 objects that are stated with 0.7 and exist with another probability."""
    random = np.random.default_rng(0)
    return [
        Judged(stated=(0.7,) * 20, exists=tuple((random.random(20) < truth).tolist()), is_first=(True,) * 20)
        for _ in range(count)
    ]


def test_existence_that_is_stated_rightly_is_credible_and_what_is_not_is_found_out() -> None:
    random = np.random.default_rng(1)
    right, wrong = (reliability(_rooms(50, truth), random) for truth in (0.7, 0.6))
    assert [own.credible for own in right] == [True] and calibration_error(right) < 0.03
    assert [own.credible for own in wrong] == [False] and calibration_error(wrong) > 0.07
    assert reliability(_rooms(1, 0.7)[:1], random)[0].count == 20


def test_open_rooms_have_what_the_configuration_says() -> None:
    settings = configuration()
    random = np.random.default_rng(2)
    rooms = [open_room(settings, 10, random) for _ in range(20)]
    objects = np.mean([len(room.objects) for room in rooms])
    alarms = np.mean([own.count(FALSE_ALARM) for room in rooms for own in room.labels])
    assert objects == pytest.approx(16.0**2 * settings.open_world.birth_density, rel=0.2)
    assert alarms == pytest.approx(settings.open_world.clutter_per_frame, abs=0.06)
    for room in rooms[:3]:
        for pose, labels, keyframe in zip(room.truth, room.labels, room.keyframes, strict=True):
            true = [row for row, label in enumerate(labels) if label != FALSE_ALARM]
            relative = se2.between(np.broadcast_to(pose, (len(true), 3)), room.objects[[labels[row] for row in true]])
            assert np.abs(np.hypot(*relative.T[:2]) - keyframe.measurements.ranges_m[true]).max(initial=0.0) < 0.6


def test_faults_touch_what_they_name_and_nothing_else() -> None:
    room = make_room(3)
    assert FAULTS["nothing wrong"](room, 3).room is room
    lacking = FAULTS["an object not on the map"](room, 3)
    kept = {item.object_id for item in lacking.room.prior.objects}
    assert len(lacking.missing) == 1 and kept | lacking.missing == set(range(8)) and not kept & lacking.missing
    elsewhere = FAULTS["two objects displaced by 1 m"](room, 3)
    off = [
        np.hypot(*(after.pose - before.pose)[:2])
        for before, after in zip(room.prior.objects, elsewhere.room.prior.objects, strict=True)
    ]
    np.testing.assert_allclose(off, [1.0 if n in elsewhere.displaced else 0.0 for n in range(8)], atol=1e-12)
    swapped = FAULTS["first view wrong"](room, 3).room
    changed = [
        k
        for k, (one, other) in enumerate(zip(room.keyframes, swapped.keyframes, strict=True))
        if not np.array_equal(one.measurements.features, other.measurements.features)
    ]
    assert len(changed) == 1 and all(not own for own in room.associations[: changed[0]])


def test_every_room_of_places_anywhere_has_a_detection_that_is_anywhere() -> None:
    """One in a hundred, and at least one; all others are as they were."""
    for seed in range(5):
        room = make_room(seed)
        faulty = FAULTS["1 % of places anywhere"](room, seed)
        detections = sum(map(len, room.associations))
        moved = {
            (k, row)
            for k, (one, other) in enumerate(zip(room.keyframes, faulty.room.keyframes, strict=True))
            for row in np.flatnonzero(one.measurements.ranges_m != other.measurements.ranges_m).tolist()
        }
        assert faulty.outliers == moved and len(moved) == max(1, round(0.01 * detections))


def test_a_second_copy_of_an_object_is_a_ghost() -> None:
    true = np.array([[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [0.0, 5.0, 1.0]])
    poses = np.zeros((7, 7))
    poses[:6, :2] = np.concatenate([true[:, :2], true[:, :2] + 0.6])
    poses[6, :2] = 9.0
    belief = SimpleNamespace(object_poses=poses, existence=np.array([0.9] * 5 + [0.4, 0.9]))
    assert _ghosts(belief, SimpleNamespace(objects=true)) == 3  # two copies, and what is nowhere near
    assert _ghosts(belief, SimpleNamespace(objects=np.zeros((0, 3)))) == 6


def test_a_map_that_is_known_better_is_off_by_less() -> None:
    room = make_room(5)
    better = with_map_known_to(room, 0.5 * SIGMA_MAP[0])
    for before, after, place in zip(room.prior.objects, better.prior.objects, room.objects, strict=True):
        np.testing.assert_allclose(after.pose[:2] - place[:2], 0.5 * (before.pose[:2] - place[:2]), atol=1e-12)
        np.testing.assert_allclose(after.covariance[0, 0], 0.25 * before.covariance[0, 0])


def test_who_is_told_the_associations_names_what_was_displaced_if_the_map_is_good_enough() -> None:
    told = []
    for fault in ("nothing wrong", "two objects displaced by 1 m, map to 0.1 m"):
        faulty = FAULTS[fault](make_room(2), 2)
        moved = moved_if_associations_were_known(faulty, 0.05, 1.0)
        told.append(set(np.flatnonzero(moved > 0.9).tolist()))
        assert told[-1] == set(faulty.displaced)
    assert len(told[1]) == 2


@pytest.mark.long
@pytest.mark.slow
def test_a_quick_run_of_the_study_writes_claims_and_tables(tmp_path: Path) -> None:
    files = run(tmp_path, quick=True, jobs=1, seed=9)  # a room whose first view leaves little open
    result = json.loads(files[0].read_text(encoding="utf-8"))
    assert set(result["closed"]) == set(FAULTS) and len(result["claims"]) == 13
    assert result["open"]["entries"] > 0 and 0.0 <= result["open"]["rooms_with_ghost"] <= 1.0
    assert "two objects displaced by 1 m" in files[1].read_text(encoding="utf-8")

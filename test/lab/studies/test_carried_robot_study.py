"""The study of a robot that is carried: how it is judged, and one room."""

from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.studies.carried_robot.recognition import (
    in_map,
    known_before,
    num_seen_again,
    share_recognised,
)
from semantic_slam_lab.studies.carried_robot.run import DRIVES, Driven, driven, is_sure_and_wrong
from semantic_slam_lab.studies.carried_robot.study import METHODS, claims_of

ROW = Driven(
    seed=0,
    noticed_after=9,
    false_alarms=0,
    found_after=12,
    seen_again=2,
    recognised=1.0,
    error_m=0.1,
    probability=1.0,
    is_sure_and_wrong=False,
    cpu_s=1.0,
    slowest_s=0.1,
)


@pytest.mark.long
def test_in_a_room_with_a_saved_map_it_is_noticed_and_found() -> None:
    found = driven("saved map", METHODS["ours"], 0)
    assert found.noticed_after is not None and found.noticed_after < 10
    assert found.found_after is not None and not found.is_sure_and_wrong and found.false_alarms == 0


@pytest.mark.parametrize(("late", "holds"), [(1, True), (2, False)])
def test_nine_rooms_of_ten_have_to_notice_within_ten_keyframes(late: int, holds: bool) -> None:
    rows = [ROW] * (10 - late) + [replace(ROW, noticed_after=10)] * late
    noticed, found = claims_of({"own map": {"ours": rows}})
    assert noticed.measured == f"{10 - late} of 10"
    assert noticed.holds == holds and found.holds


def test_a_room_that_shows_one_known_object_again_asks_for_nobody_to_be_found() -> None:
    rows = [ROW] * 8 + [replace(ROW, seen_again=1, found_after=None)] * 2
    _, found = claims_of({"own map": {"ours": rows}})
    assert found.measured == "8 of 8" and found.holds
    _, lost = claims_of({"own map": {"ours": [*rows[:7], replace(ROW, found_after=None)]}})
    assert lost.measured == "7 of 8" and not lost.holds


def test_who_is_found_where_little_is_seen_again_does_not_make_up_for_who_is_not_found() -> None:
    unseen = replace(ROW, seen_again=1)
    _, lost = claims_of({"own map": {"ours": [replace(ROW, found_after=None)] * 5 + [unseen] * 5}})
    assert lost.measured == "0 of 5" and not lost.holds
    _, nowhere = claims_of({"own map": {"ours": [unseen] * 10}})
    assert nowhere.measured == "0 of 0" and not nowhere.holds


def test_what_is_seen_twice_before_and_after_is_seen_again() -> None:
    labels = [[3, 5], [3, 5, -1], [7], [3, -1], [3, 5], [7]]
    assert num_seen_again(labels, 3) == 1
    assert known_before([[0, 1], [0, 2, -1], [-1]], labels, 3) == {0: 3, 1: 5, 2: 5}


def test_a_true_place_in_a_map_that_is_turned_is_where_it_is_by_the_objects() -> None:
    objects = np.array([[0.0, 0.0], [2.0, 0.0], [9.0, 9.0]])
    places = {7: np.array([1.0, 1.0]), 8: np.array([1.0, 3.0]), 9: np.array([5.0, 5.0])}
    at = in_map(np.array([1.0, 1.0]), places, {7: 0, 8: 1}, objects)
    np.testing.assert_allclose(at, [0.0, 2.0], atol=1e-12)


def test_who_is_not_carried_drives_as_long() -> None:
    carried, stays = (DRIVES["saved map"](METHODS[name], 1) for name in ("ours", "not_carried"))
    assert len(carried.keyframes) == len(stays.keyframes) == stays.carried_at
    assert np.hypot(*(carried.truth[carried.carried_at] - carried.truth[carried.carried_at - 1])[:2]) >= 3.0


def test_sure_and_wrong_is_who_excludes_where_the_robot_is() -> None:
    drive = DRIVES["saved map"](METHODS["not_carried"], 2)
    belief = drive.engine.process(drive.keyframes[0])
    assert not is_sure_and_wrong(belief, drive.truth[0])
    assert is_sure_and_wrong(belief, drive.truth[0] + [1.0, 0.0, 0.0])
    wide = replace(belief, pose_covariances=belief.pose_covariances + np.diag([16.0, 16.0, 0.0, 0.0, 0.0, 0.0]))
    assert not is_sure_and_wrong(wide, drive.truth[0] + [1.0, 0.0, 0.0])


def test_what_is_seen_again_is_recognised_by_the_name_that_it_had() -> None:
    labels = [[3, 5], [3, -1], [5, 7], [3]]
    assert share_recognised([[0, 1], [0, 9], [1, 2], [0]], labels, 2) == 1.0  # object 7 was not known
    assert share_recognised([[0, 1], [0, 9], [0, 2], [4]], labels, 2) == 0.0
    assert share_recognised([[0, 1], [0, 9], [], [4]], [*labels[:2], [], [8]], 2) is None

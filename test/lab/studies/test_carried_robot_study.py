"""The study of a robot that is carried: how it is judged, and one room."""

from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.studies.carried_robot.recognition import share_recognised
from semantic_slam_lab.studies.carried_robot.run import DRIVES, Driven, driven, is_sure_and_wrong
from semantic_slam_lab.studies.carried_robot.study import METHODS, claims_of

ROW = Driven(
    seed=0,
    noticed_after=9,
    false_alarms=0,
    found_after=12,
    recognised=1.0,
    error_m=0.1,
    probability=1.0,
    is_sure_and_wrong=False,
    cpu_s=1.0,
    slowest_s=0.1,
)


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

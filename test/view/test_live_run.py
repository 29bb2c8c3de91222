"""What the page learns of a run that goes on: the newest of it, whatever came before the view, and which run it is."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest
from worlds.belief_factory import (
    CLASSES,
    OBJECTS,
    belief_at,
    compressed_image,
    measurements_at,
    picture,
    run_configuration,
    small_belief,
    true_path,
    visible,
)

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.view import timeline
from semantic_slam.view.extent import Extent
from semantic_slam.view.live_run import LiveRun

PATH = true_path(24)
NAMES = ("",) * len(OBJECTS)


def belief(k: int) -> HybridBelief:
    return belief_at(k, PATH, CLASSES, NAMES)


def follow(run: LiveRun, *keyframes: int) -> LiveRun:
    for k in keyframes:
        run.add_belief(belief(k))
    return run


def whole(run: LiveRun) -> dict[str, Any]:
    return run.changes("", 0)


def keyframes(found: dict[str, Any]) -> list[int]:
    return [frame["k"] for frame in found["frames"]]


def test_a_page_learns_only_what_is_new_to_it() -> None:
    run = follow(LiveRun(), 0, 1, 2)
    first = run.changes("", 0)
    assert keyframes(first) == [0, 1, 2] and len(first["objects"]) == len(OBJECTS)
    assert run.changes(first["session"], first["version"])["frames"] == []
    follow(run, 3)
    assert 3 in keyframes(run.changes(first["session"], first["version"]))
    assert keyframes(run.changes("of another view", first["version"])) == [0, 1, 2, 3]


def test_a_view_that_comes_late_begins_where_it_comes() -> None:
    found = whole(follow(LiveRun(), 9, 10))
    assert keyframes(found) == [9, 10] and found["state"]["missed"] == 0
    assert len(found["frames"][0]["o"]) == len(OBJECTS)  # of every object, not only of those that changed


def test_keyframes_that_were_lost_are_counted() -> None:
    assert whole(follow(LiveRun(), 0, 1, 5))["state"]["missed"] == 3


def test_memory_is_bounded_and_the_oldest_keyframe_tells_of_all_objects(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "KEPT", 3)
    found = whole(follow(LiveRun(), *range(20)))
    assert keyframes(found) == [17, 18, 19] and found["first"] == 17
    assert sorted(row[0] for row in found["frames"][0]["o"]) == list(range(len(OBJECTS)))
    assert len(found["objects"]) == len(OBJECTS)


def test_an_ancestor_that_was_too_light_is_drawn_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two hypotheses the heavy one is drawn alone; its child dies, and the light one's path must not break."""
    monkeypatch.setattr(timeline, "SHOWN_HYPOTHESES", 1)
    run = LiveRun()
    run.add_belief(small_belief(0, [1, 2], [0, 0], [0.9, 0.1], [], [[]]))
    run.add_belief(small_belief(1, [3, 4], [1, 2], [0.8, 0.2], [], [[]]))
    before = whole(run)
    assert [len(frame["h"]) for frame in before["frames"]] == [1, 1]
    run.add_belief(small_belief(2, [5], [4], [1.0], [], [[]]))
    after = run.changes(before["session"], before["version"])
    assert [[row[:2] for row in frame["h"]] for frame in after["frames"]] == [
        [[-1, 0.9], [-1, 0.1]],
        [[0, 0.8], [1, 0.2]],
        [[1, 1.0]],
    ]


def test_an_object_that_is_gone_is_told_and_its_place_given_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "KEPT", 2)
    run = LiveRun()
    for k, objects in enumerate(([7, 8], [8], [8], [8, 9])):
        run.add_belief(small_belief(k, [k + 1], [k], [1.0], objects, [[]]))
        if k == 1:
            assert [0] in whole(run)["frames"][-1]["o"]
    assert [(place, entry["id"]) for place, entry in whole(run)["objects"]] == [(0, 9), (1, 8)]


def test_what_may_not_exist_is_told_with_its_existence() -> None:
    doubtful = dataclasses.replace(belief(3), existence=np.array([1.0, 0.4, np.nan, 1.0, 1.0, 1.0, 0.985]))
    run = LiveRun()
    run.add_belief(doubtful)
    assert whole(run)["frames"][0]["e"] == [[1, 0.4], [6, 0.98]]


def test_a_small_probability_is_not_told_as_none() -> None:
    run = LiveRun("/belief")
    run.add_belief(dataclasses.replace(belief(0), unexplained=3.4e-19, discarded_mass=1.0 / 3.0))
    (frame,) = whole(run)["frames"]
    assert frame["unexplained"] == 3.4e-19 and frame["discarded_mass"] == 0.3333333333


def test_another_run_is_another_session() -> None:
    run = follow(LiveRun(), 0, 1, 2)
    began = run.session
    follow(run, 1)  # a manager that was started again repeats itself
    assert run.session == began and whole(run)["state"]["repeated"] == 1
    follow(run, 3)
    assert run.session == began and whole(run)["state"]["repeated"] is None
    run.add_belief(dataclasses.replace(belief(0), stamp_ns=5))
    assert run.session != began and keyframes(whole(run)) == [0]


def test_the_same_bag_again_is_another_session_once_the_first_run_has_ended() -> None:
    run = follow(LiveRun(), 0, 1)
    began = run.session
    run.add_progress(ReplayProgress(belief(1).stamp_ns, 2, True))
    assert whole(run)["state"]["ended"]
    run.add_progress(ReplayProgress(0, 0, False))
    follow(run, 0)
    assert run.session != began and not whole(run)["state"]["ended"]


def test_a_configuration_of_another_run_begins_one(tmp_path: Any) -> None:
    own = run_configuration(tmp_path, CLASSES, NAMES)
    run = follow(LiveRun(), 0)
    began = run.session
    run.add_configuration(own)  # it may come after the first belief
    assert run.session == began and whole(run)["run"]["id"] == "made-up"
    run.add_configuration(dataclasses.replace(own, run_id="another"))
    assert run.session != began and whole(run)["frames"] == []


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_a_picture_finds_its_boxes_in_whatever_order_they_come(order: tuple[int, ...]) -> None:
    run, seen = LiveRun(), visible(PATH[12])
    image = compressed_image(belief(12).stamp_ns, picture(12, seen))
    steps = (
        lambda: run.add_picture(image),
        lambda: run.add_measurements(measurements_at(12, seen, CLASSES)),
        lambda: run.add_belief(belief(12)),
    )
    for step in order:
        steps[step]()
    (shown,) = whole(run)["pictures"]
    assert (shown["k"], shown["width"], shown["height"]) == (12, 560, 420) and len(shown["boxes"]) == len(seen)
    jpeg = run.picture(run.session, 12)
    assert jpeg is not None and jpeg.startswith(b"\xff\xd8")
    assert run.picture("another", 12) is None and run.picture(run.session, 3) is None


def test_what_is_told_is_json_whatever_numbers_a_belief_holds() -> None:
    odd = dataclasses.replace(belief(2), unexplained=np.nan, discarded_mass=np.inf)
    odd.object_poses[2] = np.nan
    odd.pose_covariances[0] = np.nan
    run = LiveRun()
    run.add_belief(odd)
    assert json.dumps(whole(run), allow_nan=False)


@pytest.mark.parametrize(("unexplained", "lost"), [(np.nan, None), (0.2, False), (0.9, True)])
def test_a_belief_that_does_not_know_whether_it_explains_its_data_is_not_told_as_one_that_does(
    unexplained: float, lost: bool | None
) -> None:
    run = LiveRun()
    assert whole(run)["state"]["lost"] is False
    run.add_belief(dataclasses.replace(belief(2), unexplained=unexplained))
    assert whole(run)["state"]["lost"] is lost


def test_the_charts_hold_only_what_they_show() -> None:
    run = follow(LiveRun(), *range(6))
    charts = run.charts()
    assert charts["keyframes"] == list(range(6)) and charts["html"].count("<svg") == 2
    assert "Hypothesis weights" in charts["html"] and "Discarded mass" in charts["html"]
    assert run.charts() is charts  # drawn once for all who look


def test_the_map_does_not_jump_with_every_keyframe() -> None:
    extent = Extent()
    assert extent.show(np.array([[0.0, 0.0], [10.0, 8.0]]))
    box = extent.box
    assert not extent.show(np.array([[1.0, 1.0], [10.5, 8.0]])) and extent.box == box
    assert extent.show(np.array([[0.0, 0.0], [14.0, 8.0]]))  # it grows
    assert extent.show(np.array([[0.0, 0.0], [2.0, 1.0]]))  # and shrinks where it has become empty
    assert not extent.show(np.array([[np.nan, 0.0]]))

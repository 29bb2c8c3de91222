"""Studies on photographs: what they judge by, and short runs where the photographs are there."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.studies.real_cabinet.study import settled_view
from semantic_slam_lab.studies.real_kitchen.front_end import FrontEnd, front_end
from semantic_slam_lab.studies.real_kitchen.judged import matched
from semantic_slam_lab.studies.real_kitchen.reference import Standing, agreed_places
from semantic_slam_lab.studies.real_kitchen.visual_odometry import LEAST_MATCHES, Seen, matches, relative_pose
from worlds.bags.image_folder import hand_held, write_cube_slam

from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.layouts import read_image_folder


def folder_of(path: Path) -> ImageFolder:
    write_cube_slam(path, [hand_held([0.0, 0.0, 0.0], 0.3, 0.0, 1.4, np.eye(3))], [np.array([2.0, 0.0, 0.5])])
    return read_image_folder(path)


def test_as_many_places_as_there_are_things_those_that_most_boxes_agree_on():
    rng = np.random.default_rng(0)
    things = np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 5.0]])
    places = np.concatenate(
        [thing + 0.05 * rng.standard_normal((count, 2)) for thing, count in zip(things, (30, 20, 4), strict=True)]
    )
    (first, num_first), (second, num_second) = agreed_places(places, 2)
    np.testing.assert_allclose([first, second], things[:2], atol=0.03)
    assert (num_first, num_second) == (30, 20)
    assert len(agreed_places(places, 9)) == 3
    assert agreed_places(np.zeros((0, 2)), 2) == []


def test_an_object_is_matched_by_class_and_place_one_to_one():
    there = Standing(("chair 1", "cup 1"), ("chair", "cup"), np.array([[0.0, 0.0], [1.0, 0.0]]), (9, 9))
    stated = np.array([[0.1, 0.0], [0.05, 0.0], [1.0, 0.1], [3.0, 0.0]])
    assert matched(stated, ("chair", "cup", "cup", "chair"), there) == {0: 0, 1: 2}
    assert matched(stated[3:], ("chair",), there) == {}


def test_a_class_is_settled_where_it_stays_so():
    assert settled_view(np.array([0.2, 0.995, 0.5, 0.999, 1.0])) == 3
    assert settled_view(np.array([0.999, 0.5])) is None
    assert settled_view(np.array([1.0, 1.0])) == 0


def test_the_motion_between_two_views_is_found_among_wrong_matches(tmp_path):
    camera, rng = folder_of(tmp_path / "source").camera, np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-1.0, 1.0, (80, 2)), rng.uniform(2.0, 4.0, 80)])
    T_seen_reference = np.linalg.inv(hand_held([0.1, 0.05, 0.1], 0.05, 0.02, 0.0, np.eye(3))) @ hand_held(
        [0.0, 0.0, 0.0], 0.0, 0.0, 0.0, np.eye(3)
    )
    moved = points @ T_seen_reference[:3, :3].T + T_seen_reference[:3, 3]
    pixels = moved[:, :2] / moved[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    pixels[:15] = rng.uniform(0.0, 100.0, (15, 2))
    words = rng.integers(0, 256, (80, 32), dtype=np.uint8)
    found, inliers = relative_pose(Seen(pixels, points, words), Seen(pixels, moved, words), camera, np.eye(4))
    np.testing.assert_allclose(found, T_seen_reference, atol=2e-3)
    assert 60 <= inliers <= 70
    none, count = relative_pose(Seen(pixels[:5], points[:5], words[:5]), Seen(pixels, moved, words), camera, np.eye(4))
    assert none is None
    assert count < LEAST_MATCHES


def test_features_are_matched_both_ways():
    words = np.random.default_rng(2).integers(0, 256, (20, 32), dtype=np.uint8)
    order = np.random.default_rng(3).permutation(20)
    np.testing.assert_array_equal(order[matches(words, words[order])[:, 1]], np.arange(20))
    assert matches(words[:1], words).shape == (0, 2)


@pytest.fixture(scope="module")
def seen_once() -> Callable[[ImageFolder, Path, int], FrontEnd]:
    """Odometry and boxes of the kitchen, computed once for all studies."""
    known: dict[tuple[Path, int, int], FrontEnd] = {}

    def seen(folder: ImageFolder, weights: Path, seed: int) -> FrontEnd:
        key = (folder.path, len(folder.frames), seed)
        if key not in known:
            known[key] = front_end(folder, weights, seed)
        return known[key]

    return seen


@pytest.fixture
def quick_result(
    tmp_path: Path,
    data_set: Callable[[str], Path],
    seen_once: Callable[[ImageFolder, Path, int], FrontEnd],
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[[str], dict[str, Any]]:
    """What a quick run of a study finds, with its page written."""
    data_set("cabinet_58")
    words = ["--data", str(data_set("redkitchen").parent), "--quick", "--out", str(tmp_path / "out")]
    for module in ("real_kitchen.study", "real_in_space.bags"):
        monkeypatch.setattr(f"semantic_slam_lab.studies.{module}.front_end", seen_once)
    for module in ("real_kitchen.study", "real_in_space.study"):
        monkeypatch.setattr(f"semantic_slam_lab.studies.{module}.QUICK_FRAMES", 48)

    def result(study: str) -> dict[str, Any]:
        monkeypatch.setattr("sys.argv", ["run_study", study, *words])
        run_study.command()
        assert (tmp_path / "out" / "result.html").stat().st_size > 1_000
        return json.loads((tmp_path / "out" / "result.json").read_text())

    return result


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.real_data
def test_a_quick_run_of_the_kitchen(
    quick_result: Callable[[str], dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semantic_slam_lab.studies.real_kitchen.study.METHODS", ("ours", "keyframes_0.25"))
    result = quick_result("real_kitchen")
    assert result["quick"]
    assert {"ours"} < set(result["methods"])
    assert result["counts"]["chair"] >= 2
    assert result["visual_odometry_failures"] == 0


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.real_data
def test_a_quick_run_of_real_pictures_in_space(quick_result: Callable[[str], dict[str, Any]]) -> None:
    result = quick_result("real_in_space")
    assert result["lines"]["cabinet, boxes alone"]["errors_m"][0] < 0.1
    assert result["lines"]["kitchen, depth"]["counts"]["chair"] >= 2


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.real_data
def test_a_quick_run_of_the_cabinet(
    quick_result: Callable[[str], dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semantic_slam_lab.studies.real_cabinet.study.QUICK_PASSES", 3)
    result = quick_result("real_cabinet")
    assert result["quick"]
    assert {"ours"} < set(result["methods"])

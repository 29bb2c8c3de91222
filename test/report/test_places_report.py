"""Reports of objects that are in one of several places: the map shows them in each."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
from worlds.belief_factory import CLASSES, START, measurements_at, run_configuration, small_belief, write_rows

from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.report.make import make_report
from semantic_slam.report.shown.keyframe import keyframe_scene


def on_either_side(*, is_settled: bool = False) -> HybridBelief:
    """Two objects at x = 2 m and x = 3 m, of which one is at y = 1.2 m or at y = -1.2 m."""
    base = small_belief(0, [1, 2], [0, 0], [0.7, 0.3], [3, 4], [[0], [0]])
    poses = pose_vector_from_planar(np.array([[2.0, 0.48, 0.0], [3.0, 0.0, 0.0]]))
    covariances = base.object_covariances.copy()
    covariances[0, 1, 1] += 0.7 * 0.3 * 2.4**2
    belief = dataclasses.replace(base, object_poses=poses, object_covariances=covariances)
    if is_settled:
        return belief
    return dataclasses.replace(
        belief,
        place_objects=np.array([0, 0], dtype=np.uint32),
        place_probabilities=np.array([0.7, 0.3]),
        place_means=np.array([[2.0, 1.2, 0.0], [2.0, -1.2, 0.0]]),
        place_covariances=np.tile(0.04 * np.eye(3), (2, 1, 1)),
    )


def page(folder: Path, belief: HybridBelief) -> str:
    run = run_configuration(folder, CLASSES, ("",) * 7)
    rows = [(topics.RUN_CONFIGURATION, START, run), (topics.BELIEF, START, belief)]
    write_rows(folder / "bag", [*rows, (topics.MEASUREMENTS, START, measurements_at(0, [0], CLASSES))])
    make_report(folder / "bag", folder / "report")
    return (folder / "report" / "report.html").read_text()


def test_a_keyframe_has_a_row_for_each_place_of_an_object_on_which_hypotheses_disagree() -> None:
    rows = keyframe_scene(on_either_side(), START, [], {3: 5, 4: 6}, {})["p"]
    np.testing.assert_allclose(np.array(rows)[:, :6], [[5, 0.7, 2, 1.2, 0.2, 0.2], [5, 0.3, 2, -1.2, 0.2, 0.2]])
    assert "p" not in keyframe_scene(on_either_side(), START, [], {4: 6}, {})
    assert "p" not in keyframe_scene(on_either_side(is_settled=True), START, [], {3: 5, 4: 6}, {})


def test_the_page_shows_the_places_and_says_what_they_are(tmp_path: Path) -> None:
    text = page(tmp_path, on_either_side())
    scene = json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', text, re.S)[1])
    assert len(scene["frames"][0]["p"]) == 2 and "in one of these places" in text


def test_the_files_of_numbers_have_every_place_of_an_object_and_a_later_run_takes_its_mean(tmp_path: Path) -> None:
    page(tmp_path, on_either_side())
    for name in ("objects.json", "report.json"):
        either, settled = json.loads((tmp_path / "report" / name).read_text())["objects"]
        assert [place["probability"] for place in either["places"]] == [0.7, 0.3]
        assert [place["position"] for place in either["places"]] == [[2.0, 1.2, 0.0], [2.0, -1.2, 0.0]]
        np.testing.assert_allclose(either["places"][1]["covariance"], 0.04 * np.eye(3))
        assert not settled.get("places")
    prior = read_map_prior(tmp_path / "report" / "objects.json").objects[0]
    np.testing.assert_allclose(prior.pose[:3], [2.0, 0.48, 0.0])


def test_a_page_of_a_run_whose_hypotheses_agree_says_nothing_of_places(tmp_path: Path) -> None:
    assert "in one of these places" not in page(tmp_path, on_either_side(is_settled=True))

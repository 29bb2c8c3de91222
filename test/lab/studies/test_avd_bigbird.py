"""The study on a scene and turntables: geometry, views, features, bias; a small run where one can render."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.simulation.scene import SceneSettings, make_scene
from semantic_slam_lab.studies.avd_bigbird import data as data
from semantic_slam_lab.studies.avd_bigbird import study as study
from semantic_slam_lab.studies.avd_bigbird.data import SceneTrack, in_object_frame
from semantic_slam_lab.studies.avd_bigbird.models import (
    INPUT_MAP,
    TurntableScores,
    aligned,
    class_processes,
    feature_sets,
    with_components,
)
from semantic_slam_lab.studies.avd_bigbird.realisations import METHODS, Problem, realisation
from semantic_slam_lab.studies.rendered.models import fit_model

from semantic_slam.classification.classifier import Scores
from semantic_slam.errors import InputError

TRUE_CLASS = 1
ANGLES = np.deg2rad(np.arange(0.0, 360.0, 10.0))
RING = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)


def scores_at(places, phase):
    """(N, 5) scores that turn with the azimuth; the last one tells nothing and is small."""
    azimuth = np.arctan2(places[:, 1], places[:, 0])
    turning = 0.25 + 0.2 * np.cos(azimuth[:, None] + phase + np.array([0.0, 1.6, 3.1, 4.7]))
    return np.concatenate([turning, np.full((len(places), 1), 0.01)], axis=1)


@pytest.fixture(scope="module")
def models():
    noise = 0.02 * np.random.default_rng(0).standard_normal((3, len(RING), 5))
    return tuple(
        fit_model(RING, scores_at(RING, phase) + noise[index], INPUT_MAP) for index, phase in enumerate((0, 2, 4))
    )


@pytest.fixture
def track():
    angles = np.deg2rad(np.arange(0.0, 300.0, 40.0))
    relative = 2.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    yaw = 0.7
    turned = relative @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    names, boxes = tuple("abcdefgh"), np.zeros((8, 4))
    return SceneTrack("desk_1", "desk", True, np.array([3.0, -1.0, yaw]), names, boxes, turned + np.array([3.0, -1.0]))


def test_relative_location_is_in_the_frame_of_the_object():
    # an object at (1, 2) that faces +y of map: a camera one metre before its front, one to its left
    places = np.array([[1.0, 3.0], [0.0, 2.0]])
    assert np.allclose(in_object_frame(places, np.array([1.0, 2.0, np.pi / 2.0])), [[1.0, 0.0], [0.0, 1.0]])


def test_range_does_not_matter_to_the_models(models):
    processes = class_processes(models)
    near, far = (processes.marginals(RING[:5] * length) for length in (1.0, 4.0))
    assert np.allclose(near.mean, far.mean) and np.allclose(near.variance, far.variance)


def test_a_heading_that_is_not_known_is_found_from_the_views(models, track):
    scores = scores_at(track.locations_m, 2.0)
    blind = replace(track, heading_known=False, planar=np.array([3.0, -1.0, 0.0]))
    found = aligned(blind, scores, class_processes(models), TRUE_CLASS)
    assert abs(found.planar[2] - 0.7) < 0.1
    assert aligned(track, scores, class_processes(models), TRUE_CLASS) is track


def test_feature_sets_follow_their_rankings():
    generator = np.random.default_rng(1)
    measured = []
    for index in range(3):
        samples = 0.02 * generator.standard_normal((40, 4, 6)) + np.array([0.9, 0.8, 0.7, 0.6, 0.1, 0.1])
        samples[..., 4] += 0.3 * index  # small on average, and all that tells the classes apart
        measured.append(TurntableScores(str(index), RING, samples, np.zeros((2, 2, 3), dtype=np.uint8)))
    sets = feature_sets(measured, seed=0)
    assert sets["mean_score"][0] == (0, 1, 2, 3)
    assert 4 in sets["importance"][0] and sets["importance"][1].argmax() == 4


def test_bias_is_the_one_that_leaves_the_true_class_least():
    axis = np.linspace(-study.MAP_HALF_WIDTH_M, study.MAP_HALF_WIDTH_M, study.MAP_SIZE)
    x, _ = np.meshgrid(axis, axis)
    bias = study.worst_bias(np.stack([1.0 / (1.0 + np.exp(8.0 * x))] * 3))  # worse the farther right
    assert np.allclose(bias, [study.BIAS_LENGTH_M, 0.0])


def test_every_method_recognises_the_true_class_and_the_key_alone_decides(models, track):
    generator = np.random.default_rng(2)
    clean = scores_at(track.locations_m, 2.0)
    samples = clean[:, None] + 0.02 * generator.standard_normal((8, 20, 5))
    scores = [Scores.of(view[:, :4]) for view in samples]
    chosen = with_components(models, (0, 1, 2, 3))
    problem = Problem(chosen, track.locations_m, scores, (), np.zeros(2))
    methods = [name for name in METHODS if name != "simple_bayes"]
    first, again, other = (realisation(problem, methods, (0, index)) for index in (3, 3, 4))
    for name in methods:
        assert np.allclose(np.exp(first[name]).sum(axis=-1), 1.0)
        assert first[name][-1].argmax() == TRUE_CLASS, name
        assert np.array_equal(first[name], again[name])
    assert not np.allclose(first["model_based"], other["model_based"])


def test_a_data_set_for_a_study_without_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.argv", ["run_study", "ch3_localization", "--out", str(tmp_path), "--avd", str(tmp_path)])
    with pytest.raises(InputError, match="has no option --avd"):
        run_study.command()
    with pytest.raises(InputError, match="give both or neither"):
        data.open_sources(tmp_path, tmp_path, None, 0, True)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.render
def test_a_small_run_on_given_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    small = SceneSettings(width=240, height=180, tour_only=True)
    monkeypatch.setattr(data, "_render_scene", lambda folder, seed, quick: make_scene(folder, seed, small))
    monkeypatch.setattr(data, "QUICK_STEP_DEG", 60)
    monkeypatch.setattr(study, "QUICK_REALISATIONS", 2)
    paths = study.run(tmp_path / "out", quick=True, jobs=1, seed=0)
    result = json.loads(paths[0].read_text())
    assert result["methods"]["ours"]["method"] == "joint"
    assert {"joint", "recursive", "model_based", "simple_bayes"} <= set(result["methods"])
    assert set(result["feature_sets"]) == {"mean_score", "importance"}
    assert paths[1].read_text().count("data:image/png") == 5
    folders = sorted((tmp_path / "out" / "data").iterdir())
    monkeypatch.setattr(study, "figures", lambda *of: [])  # those of the first run again
    again = study.run(tmp_path / "given", quick=True, jobs=1, seed=0, avd=folders[0] / "Gen_000_1", bigbird=folders[1])
    given = json.loads(again[0].read_text())
    assert given["methods"] == result["methods"] and not given["settings"]["simulated"]

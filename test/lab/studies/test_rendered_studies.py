"""The rendered experiments of chapter 3: what needs no picture, and a few pictures where the machine can render."""

import json
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.studies.rendered import model_uncertainty as study
from semantic_slam_lab.studies.rendered.aliasing import AliasingMap, aliasing_map, fixed_tracks
from semantic_slam_lab.studies.rendered.figures import reliability_bins
from semantic_slam_lab.studies.rendered.methods import METHODS, class_processes, classify
from semantic_slam_lab.studies.rendered.models import fit_model, grid, map_places
from semantic_slam_lab.studies.rendered.realisations import ALL, Problem, realisation
from semantic_slam_lab.studies.rendered.tracks import NUM_VIEWS, SEEN_FROM_Y_M, inside, random_tracks
from semantic_slam_lab.studies.rendered.views import CLASSES, LEAST_RANGE_M, Subject, camera_pose, measure

from semantic_slam.classification.classifier import Scores

TRUE_CLASS = 1


@pytest.fixture(scope="module")
def models():
    """Three classes whose scores turn with the azimuth, each from another phase on."""
    places = grid(0.9)
    azimuth = np.arctan2(places[:, 1], places[:, 0])
    fitted = []
    for phase in (0.0, 2.0, 4.0):
        logits = 2.0 * np.cos(azimuth[:, None] + phase + np.array([0.0, 2.1, 4.2]))
        shares = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
        fitted.append(fit_model(places, shares + 0.02 * np.random.default_rng(3).standard_normal(shares.shape)))
    return tuple(fitted)


def scores_of(models, track, spread):
    """(K, 20, 3) samples about the true class's mean prediction."""
    mean = class_processes(models, "sigma_n").marginals(track).mean[:, TRUE_CLASS]
    return mean[:, None] + spread * np.random.default_rng(1).standard_normal((len(track), 20, 3))


def test_camera_looks_at_the_object():
    pose = camera_pose(np.array([1.2, -0.7]), 0.31)
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3)) and np.linalg.det(pose[:3, :3]) > 0.0
    target = np.linalg.inv(pose) @ np.array([0.0, 0.0, 0.31, 1.0])
    assert np.allclose(target[:2], 0.0) and target[2] > 0.0  # on the optical axis, ahead
    assert pose[2, 1] < 0.0  # the image's y points down


def test_tracks_stay_where_the_models_know_and_see_the_recoloured_side():
    tracks = random_tracks(5, np.random.default_rng(0))
    assert tracks.shape == (5, NUM_VIEWS, 2)
    assert inside(tracks).all() and (tracks[..., 1] > SEEN_FROM_Y_M).all()
    assert (np.hypot(*grid(0.5).T) >= LEAST_RANGE_M).all()


def test_every_method_recognises_scores_of_the_true_class(models):
    tracks = random_tracks(2, np.random.default_rng(4))
    samples = np.stack([scores_of(models, track, 0.01) for track in tracks])
    found = classify(models, "sigma_n", tracks, samples, jobs=1)
    assert set(found) == set(METHODS)
    for name in ("joint", "joint_kernel", "recursive", "model_based"):
        assert np.allclose(np.exp(found[name]).sum(axis=-1), 1.0)
        assert (found[name][:, -1].argmax(axis=-1) == TRUE_CLASS).all(), name


def test_aliasing_vanishes_with_the_bias(models):
    found = aliasing_map(class_processes(models, "sigma_n"), TRUE_CLASS)
    # without a bias the true class's residual is zero and its variance like the others'
    assert found.unbiased[..., TRUE_CLASS].mean() > found.biased[..., TRUE_CLASS].mean()


def test_tracks_are_fixed_by_the_map():
    places, size = map_places()
    wrong = (places[:, 0] < 0.0).reshape(size, size)  # everything on the left
    biased = np.zeros((size, size, 3))
    biased[..., TRUE_CLASS], biased[..., 0] = ~wrong, wrong
    tracks = fixed_tracks(
        AliasingMap(biased, np.eye(3)[np.full((size, size), TRUE_CLASS)]), TRUE_CLASS, np.random.default_rng(2)
    )
    assert (tracks["hard"][:, 0] < 0.0).all()
    assert (tracks["moderate"][:, 0] > 0.0).all() and (tracks["easy"][:, 0] > 0.0).all()
    assert tracks["easy"][:, 0].min() > tracks["moderate"][:, 0].min()


def test_without_localisation_error_the_average_over_tracks_changes_nothing(models):
    track = random_tracks(1, np.random.default_rng(4))[0]
    problem = Problem("easy", track, [Scores.of(view) for view in scores_of(models, track, 0.05)])
    found = realisation(models, "sigma_n", problem, 1e-7, ALL, (0, 0))
    assert np.allclose(found["ours"], found["joint"], atol=1e-3)


def test_reliability_bins_add_up():
    logs = np.log(np.array([[[0.8, 0.1, 0.1], [0.2, 0.5, 0.3]]]))
    confidence, right, count = reliability_bins(logs, 0)
    assert count.sum() == 2.0
    assert confidence[11] == pytest.approx(0.8) and right[11] == 1.0  # 0.8 lies in (11/15, 12/15]
    assert confidence[7] == pytest.approx(0.5) and right[7] == 0.0


@pytest.mark.slow
@pytest.mark.render
def test_views_do_not_depend_on_the_number_of_processes_and_a_recoloured_side_changes_them():
    places = np.array([[0.0, 1.4], [1.4, 0.0]])
    plain = measure(Subject("crate"), places, (0, 1), 1, "plain")
    again = measure(Subject("crate"), places, (0, 1), 1, "again")
    red = measure(study.SUBJECT, places, (0, 1), 1, "red")
    assert plain.shape == (2, study.NUM_PASSES, len(CLASSES))
    assert np.array_equal(plain, again) and np.allclose(plain.sum(axis=-1), 1.0)
    assert not np.allclose(plain[0], red[0])  # its left side
    assert np.allclose(plain[1].mean(axis=0), red[1].mean(axis=0), atol=0.02)  # its front


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.render
def test_result_and_page_of_a_tiny_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(study, "QUICK_TRACKS", 2)
    monkeypatch.setattr(study, "QUICK_GRID_STEP_M", 1.1)
    data, page = study.run(tmp_path, quick=True, jobs=1, seed=0)
    result = json.loads(data.read_text())
    for noise in ("none", "sigma_n"):
        methods = result["test_noise"][noise]["methods"]
        assert methods["ours"]["method"] == "joint" and {"recursive", "model_based", "simple_bayes"} <= set(methods)
    assert page.read_text().count("data:image/png") == 6
    assert all({"text", "source", "thesis", "measured", "holds"} == set(claim) for claim in result["claims"])

"""Viewpoint models from bags whose poses are known, and the page about them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.processes.commands import call
from worlds.views.synthetic_views import FEATURES, synthetic_samples

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.contracts.viewpoint_model import looking_from
from semantic_slam.training.viewpoint.calibration import residuals
from semantic_slam.training.viewpoint.fit import fit_samples
from semantic_slam.training.viewpoint.known_poses import views_of_bag
from semantic_slam.training.viewpoint.page import write_page
from semantic_slam.training.viewpoint.samples import ClassSamples

BAGS = Path(__file__).parents[2] / "bags"


def single_views(seed: int, count: int = 6) -> ClassSamples:
    """Every draw a view of its own, at slightly different azimuths."""
    data = synthetic_samples(0.0, seed=seed, draws=count)
    azimuth = np.repeat(data.azimuth_rad, count) + np.tile(np.linspace(-0.02, 0.02, count), len(data.azimuth_rad))
    order = np.argsort(azimuth)
    features = data.features.reshape(-1, 1, 3)[order]
    return ClassSamples(azimuth[order], features, data.feature_covariances.reshape(-1, 1, 3, 3)[order])


@pytest.mark.long
@pytest.mark.slow
def test_a_standing_robot_sees_one_class_from_one_direction() -> None:
    """The bag's README: a desk, seen from an azimuth of 99 degrees, fifty times."""
    samples, left_out = views_of_bag(BAGS / "standing.mcap", PerceptionConfiguration(num_passes=5))
    assert list(samples) == ["desk"] and left_out == {}
    assert samples["desk"].features.shape == (50, 1, 5)
    np.testing.assert_allclose(np.rad2deg(samples["desk"].azimuth_rad), 99.0, atol=1.0)
    assert samples["desk"].stamps_ns is not None and len(set(samples["desk"].stamps_ns)) == 50


@pytest.mark.long
@pytest.mark.slow
def test_one_view_per_direction_is_enough_to_fit() -> None:
    fitted = fit_samples({"one": single_views(1)}, FEATURES)
    assert fitted.report["one"]["mean_squared_whitened_residual"] == pytest.approx(3.0, abs=0.8)
    many = fit_samples({"one": synthetic_samples(0.0, seed=2)}, FEATURES)
    azimuth = looking_from(np.linspace(0.0, 6.0, 20))
    first, second = (m.predict(np.zeros(20, dtype=int), azimuth).mean for m in (fitted.model, many.model))
    np.testing.assert_allclose(first, second, atol=0.12)


def slow_drive(seed: int, rounds: int = 3, places: int = 12, frames: int = 3) -> ClassSamples:
    """Rounds about an object, in which the frames from one place share their error: the same light, the same box."""
    generator = np.random.default_rng(seed)
    start = np.arange(rounds * places) * 2.0 * np.pi / places + np.repeat(generator.uniform(0.0, 0.5, rounds), places)
    error = 0.1 * generator.normal(size=(len(start), 3))
    azimuth = np.repeat(start, frames) + np.tile(0.01 * np.arange(frames), len(start))
    mean = np.stack([0.5 + 0.4 * np.cos(azimuth), 0.5 + 0.3 * np.sin(azimuth), 0.2 + 0.0 * azimuth], axis=1)
    features = mean + np.repeat(error, frames, axis=0) + 0.01 * generator.normal(size=(len(azimuth), 3))
    stamps = np.arange(len(azimuth))
    order = np.argsort(azimuth % (2.0 * np.pi))
    covariances = np.zeros((len(azimuth), 1, 3, 3))
    return ClassSamples(azimuth[order], features[order, None], covariances, stamps_ns=stamps[order])


@pytest.mark.long
@pytest.mark.slow
def test_what_is_left_out_of_a_drive_is_as_far_off_as_another_drive() -> None:
    """Left out by direction, a view is judged by the next frame, which has the same error."""
    data = slow_drive(1)
    for fold in range(3):
        assert set(data.stamps_ns[data.folds == fold]) == set(range(36 * fold, 36 * fold + 36))
    fitted = fit_samples({"one": data}, FEATURES)
    another = [residuals(fitted.model, 0, slow_drive(seed)).squared.mean() for seed in range(2, 8)]
    reported = fitted.report["one"]["mean_squared_whitened_residual"]
    by_direction = fit_samples({"one": replace(data, stamps_ns=None)}, FEATURES).report["one"]
    assert reported == pytest.approx(np.mean(another), rel=0.5)
    assert by_direction["mean_squared_whitened_residual"] < 0.5 * np.mean(another)
    assert fitted.report["one"]["left_out"] == "thirds by time"
    assert by_direction["left_out"] == "every third direction"


@pytest.mark.slow
def test_the_page_shows_every_class_and_escapes_names(tmp_path: Path) -> None:
    samples = {"<b>bold</b>": single_views(3, 2), "two": single_views(4, 2)}
    write_page(tmp_path / "page.html", fit_samples(samples, FEATURES), samples)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert text.count("data:image/png;base64,") == 2
    assert "&lt;b&gt;bold&lt;/b&gt;" in text and "<b>" not in text
    assert "http" not in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "--turntables"),
        (["--bag", "a", "--turntables", "b"], "not allowed"),
        (["--bag", "missing_bag"], "missing_bag"),
    ],
)
def test_a_wrong_source_is_one_line(arguments: list[str], named: str, tmp_path: Path) -> None:
    done = call(tmp_path, "semantic_slam.cli.fit_viewpoint_models", *arguments, "--out", tmp_path / "m")
    assert done.returncode == 2
    assert named in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "m").exists()

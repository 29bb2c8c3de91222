"""Fitting to objects seen from few directions: those from too few are left out and counted, the others are judged."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from worlds.views.synthetic_views import FEATURES, synthetic_samples

from semantic_slam.cli import fit_viewpoint_models
from semantic_slam.contracts.viewpoint_model import looking_from
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.training.viewpoint.calibration import left_out_residuals, residuals
from semantic_slam.training.viewpoint.fit import fit_samples
from semantic_slam.training.viewpoint.regression import fit_class
from semantic_slam.viewpoint.spherical_process import fitted_classes

OBJECTS = {"cup": (0, 90, 180, 270), "bowl": (0, 120, 240), "spoon": (0, 90), "fork": (0, 1)}
"""Degrees from which each was photographed; a degree is within one direction."""


def fit(monkeypatch: pytest.MonkeyPatch, folder: Path, out: Path) -> None:
    words = ["--turntables", folder, "--pattern", "{object}-{azimuth}.png", "--draws", "2", "--out", out]
    monkeypatch.setattr("sys.argv", ["fit_viewpoint_models", *map(str, words)])
    fit_viewpoint_models.command()


@pytest.mark.long
@pytest.mark.slow
def test_a_sparse_object_is_left_out_and_does_not_end_the_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    pictures, out = tmp_path / "pictures", tmp_path / "models.safetensors"
    pictures.mkdir()
    picture = np.full((60, 80, 3), 255, dtype=np.uint8)
    picture[10:50, 20:60] = 40, 40, 200
    for name, angles in OBJECTS.items():
        for angle in angles:
            cv2.imwrite(str(pictures / f"{name}-{angle}.png"), picture)
    fit(monkeypatch, pictures, out)
    printed = capsys.readouterr().out
    for name in ("spoon", "fork"):
        assert f"left out: views: fewer than 3 directions of '{name}' (2)" in printed
    report = json.loads(out.with_suffix(".json").read_text(), parse_constant=pytest.fail)
    assert {name: own["coverage"]["views"] for name, own in report.items()} == {"bowl": 3, "cup": 4}
    for name in ("cup", "bowl"):
        for file in pictures.glob(f"{name}-*.png"):
            file.unlink()
    with pytest.raises(InputError, match="no object was seen from 3 directions"):
        fit(monkeypatch, pictures, tmp_path / "none.safetensors")


def test_every_view_left_out_counts_the_same() -> None:
    data = synthetic_samples(0.0, seed=0, views=4)  # the first fold has two views, the others have one
    folds = [np.array([0, 3]), np.array([1]), np.array([2])]
    nll = []
    for left_out in folds:
        fits = [fit_class(data.select(np.setdiff1d(np.arange(4), left_out)))]
        model = fitted_classes(("class",), FEATURES, fits)
        nll += [residuals(model, 0, data.select(left_out)).nll] * len(left_out)
    assert left_out_residuals(data, FEATURES).nll == pytest.approx(np.mean(nll), rel=1e-9)


@pytest.mark.parametrize("degrees", [(0, 3, 6), (0, 30, 60), (0, 5, 10, 15), (0, 20, 40, 60), (0, 15, 30, 45, 60)])
def test_the_back_of_an_object_that_was_seen_from_one_side_is_outside_the_coverage(degrees: tuple[int, ...]) -> None:
    last, around = degrees[-1], max(1.5 * degrees[1], 12.0)
    for turned in (0, 150, 330):  # wherever the side is
        own = covered((np.array(degrees) + turned) % 360)
        inside, outside = (int(np.ceil(around + off)) for off in (-1.0, 1.0))
        assert {(angle + turned) % 360 for angle in range(-inside, last + inside + 1)} <= own
        assert own <= {(angle + turned) % 360 for angle in range(-outside, last + outside + 1)}


@pytest.mark.parametrize("degrees", [(0, 120, 240), (0, 90, 180, 270), (0, 80, 170, 270)])
def test_few_views_all_around_cover_the_circle(degrees: tuple[int, ...]) -> None:
    assert covered(np.array(degrees)) == set(range(360))


def test_two_sides_leave_what_is_between_them_outside_the_coverage() -> None:
    sides = set(range(17)) | set(range(347, 360)) | set(range(107, 137))
    assert covered(np.array([0, 3, 120, 123])) <= sides


@pytest.mark.parametrize("jitter", [0.0, 1e-3])
def test_a_robot_that_stands_covers_its_surroundings_alone(jitter: float) -> None:
    own = covered(90.0 + jitter * np.arange(3))
    assert set(range(79, 102)) <= own <= set(range(77, 104))


@pytest.mark.parametrize(
    ("fault", "remedy"),
    [
        ({"views": 2}, "samples of class 'one': fewer than 3 views; give more, or leave the class out"),
        ({"azimuth_rad": np.nan}, "samples of class 'one': angles, features or covariances that are not finite"),
        ({"features": np.nan}, "samples of class 'one': angles, features or covariances that are not finite"),
        ({"feature_covariances": np.inf}, "samples of class 'one': angles, features or covariances that are not"),
        ({"features": 1e200}, r"samples of class 'one': features beyond 1e\+06; give scores"),
        ({"draws": 0}, "samples of class 'one': 0 draws of 3 features; give one draw at least, of 3"),
    ],
)
def test_a_class_to_which_no_model_can_be_fitted_is_named(fault: dict[str, Any], remedy: str) -> None:
    sizes = {name: fault[name] for name in ("views", "draws") if name in fault}
    wrong = synthetic_samples(0.0, seed=0, **({"views": 12} | sizes))
    arrays = {name: np.full_like(getattr(wrong, name), fault[name]) for name in fault if name not in sizes}
    whole = synthetic_samples(0.0, seed=1, views=12)
    with pytest.raises(InputError, match=remedy) as error:
        fit_samples({"whole": whole, "one": replace(wrong, **arrays)}, FEATURES)
    assert "\n" not in str(error.value)


def test_samples_of_other_features_or_of_no_class_are_refused() -> None:
    with pytest.raises(InputError, match="class 'one': 6 draws of 3 features; give one draw at least, of 2"):
        fit_samples({"one": synthetic_samples(0.0, seed=1)}, FEATURES[:2])
    with pytest.raises(InputError, match="no class; give views of one at least"):
        fit_samples({}, FEATURES)


def covered(degrees: Array) -> set[int]:
    """Whole degrees from which a class that was fitted from these directions is in its coverage."""
    views = synthetic_samples(0.0, seed=0, views=len(degrees))
    model = fitted_classes(("class",), FEATURES, [fit_class(replace(views, azimuth_rad=np.deg2rad(degrees)))])
    around = looking_from(np.deg2rad(np.arange(360.0)))
    return set(np.flatnonzero(model.in_coverage(np.zeros(360, dtype=int), around)).tolist())

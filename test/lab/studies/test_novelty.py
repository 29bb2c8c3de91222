"""The novelty study: its curves against closed forms, and the whole of it on a small folder of photographs."""

import json
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.studies.novelty import features, study
from semantic_slam_lab.studies.novelty.curves import KNOWN, RATES, UNKNOWN, Scores, curve_of, separation
from semantic_slam_lab.studies.novelty.pictures import coloured_blocks, noise


def gaussian_scores(shift: float, count: int = 200_000) -> Scores:
    """Of known views N(0, 1), and of unknown ones N(shift, 1)."""
    random = np.random.default_rng(0)
    known, unknown = random.normal(size=count), random.normal(shift, size=count)
    return Scores(np.sort(random.normal(size=count)), {KNOWN: known, UNKNOWN: unknown})


def test_curves_of_two_gaussians_are_those_of_the_normal_distribution() -> None:
    """At false alarms a the share found is Phi(shift - z_(1 - a)); the area under the curve is Phi(shift / sqrt 2)."""
    from scipy.stats import norm

    found = curve_of([gaussian_scores(1.5)])
    expected = norm.cdf(1.5 - norm.ppf(1.0 - np.array(RATES)))
    for kind in ("stated", "realised"):
        np.testing.assert_allclose(found[kind][UNKNOWN], expected, atol=5e-3)
        np.testing.assert_allclose(found[kind][KNOWN], RATES, atol=5e-3)
    assert separation([gaussian_scores(1.5)])[UNKNOWN] == pytest.approx(norm.cdf(1.5 / np.sqrt(2.0)), abs=3e-3)


def test_false_alarms_that_are_not_the_stated_ones_show() -> None:
    """Views left out of the fit that lie one standard deviation lower than new ones promise too much."""
    own = gaussian_scores(0.0)
    found = curve_of([Scores(own.limits - 1.0, own.groups)])
    at = RATES.index(0.05)
    assert found["stated"][KNOWN][at] == pytest.approx(0.26, abs=0.01)  # 1 - Phi(1.645 - 1)
    assert found["realised"][KNOWN][at] == pytest.approx(0.05, abs=1e-3)


def test_ties_count_by_half() -> None:
    tied = Scores(np.zeros(3), {KNOWN: np.array([0.0, 1.0]), UNKNOWN: np.array([1.0])})
    assert separation([tied])[UNKNOWN] == 0.75


def test_pictures_without_an_object_are_the_same_again() -> None:
    for make in (noise, coloured_blocks):
        first, again = (make(32, np.random.default_rng(3)) for _ in range(2))
        assert first.shape == (32, 32, 3) and first.dtype == np.uint8 and (first == again).all()
    assert len(np.unique(coloured_blocks(64, np.random.default_rng(0)).reshape(-1, 3), axis=0)) <= 5


@pytest.mark.long
@pytest.mark.real_data
@pytest.mark.slow
def test_of_photographs_all_curves_rise_and_noise_is_found(
    data_set, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The quick part on 24 objects."""
    folder = tmp_path / "coil100"
    folder.mkdir()
    for number in range(2, 26):
        for file in data_set("coil100").glob(f"obj{number}__*0.jpg"):
            (folder / file.name).symlink_to(file)
    monkeypatch.setattr(features, "DRAWS", {features.ALONE: 1})
    study.run(tmp_path / "out", quick=True, jobs=1, seed=0, data=tmp_path)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    curve = result["networks"]["shipped"]["alone"]["ours"]["curve"]["realised"]
    assert all(np.all(np.diff(shares) >= 0.0) for shares in curve.values())
    assert curve["noise"][RATES.index(0.05)] > 0.9

"""Worlds drawn from priors: their generator against closed forms, the tests of calibration against what is known."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.studies.drawn_worlds.calibration import p_values, rejected, reliability
from semantic_slam_lab.studies.drawn_worlds.errors import RepeatedErrors
from semantic_slam_lab.studies.drawn_worlds.pages import claims_of
from semantic_slam_lab.studies.drawn_worlds.path import PHASE_S
from semantic_slam_lab.studies.drawn_worlds.path import Path as Drive
from semantic_slam_lab.studies.drawn_worlds.ranks import Stated
from semantic_slam_lab.studies.drawn_worlds.study import configuration, run
from semantic_slam_lab.studies.drawn_worlds.truths import RIGHT, TRUTHS, WITHIN_PRIOR
from semantic_slam_lab.studies.drawn_worlds.worlds import drawn_world

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.geometry import se2

PLACES = np.array([[2.0, 0.0], [2.1, 0.3], [3.0, -1.0]])


def test_a_drive_is_the_composition_of_its_parts() -> None:
    drive = Drive.drawn(np.random.default_rng(0), 5.0)
    parts = [drive.motion(start, start + 0.3) for start in np.arange(0.0, 4.5, 0.3)]
    pose = np.zeros(3)
    for part in parts:
        pose = se2.compose(pose, part)
    np.testing.assert_allclose(pose, drive.pose(4.5), atol=1e-9)
    driven, turned = drive.extent(0.5 * PHASE_S, 2.0 * PHASE_S)
    np.testing.assert_allclose(driven, drive.twists[0, 0] * 0.5 + drive.twists[1, 0])
    np.testing.assert_allclose(turned, abs(drive.twists[0, 2]) * 0.5 + abs(drive.twists[1, 2]))


@pytest.mark.long
@pytest.mark.slow
def test_errors_that_repeat_have_the_stated_covariance() -> None:
    settings = DetectionErrorsConfiguration(
        correlated_share=0.9, common_range_share=0.3, common_bearing_share=0.7, neighbour_m=0.5, motion_m=1.0
    )
    random, drawn = np.random.default_rng(1), []
    for _ in range(4000):
        errors = RepeatedErrors(settings)
        first = errors.draw(PLACES, random)
        errors.move(np.array([0.2, 0.0, 0.0]))
        drawn.append(np.concatenate([first, errors.draw(PLACES - [0.2, 0.0], random)]))
    ranges = np.array(drawn)[..., 0]
    near = np.exp(-0.5 * 0.1 / 0.25)  # the first two are sqrt(0.1) m apart
    found = np.cov(ranges.T)
    np.testing.assert_allclose(np.diag(found), 1.0, atol=0.08)
    np.testing.assert_allclose(found[0, 1], 0.3 + 0.7 * near, atol=0.08)
    np.testing.assert_allclose(found[0, 3], np.exp(-0.2), atol=0.08)


def test_an_odd_rank_is_found_and_even_ones_are_not() -> None:
    random = np.random.default_rng(2)
    ranks = {f"even {n}": random.random(300).tolist() for n in range(8)}
    assert rejected(p_values(ranks)) == []
    sure = np.clip(0.5 + 1.5 * (random.random(300) - 0.5), 0.0, 1.0)  # of a belief whose sigma is too small
    assert rejected(p_values({**ranks, "too sure": sure.tolist()})) == ["too sure"]


def test_a_stated_probability_that_is_right_has_even_ranks() -> None:
    random = np.random.default_rng(3)
    stated = random.random(4000)
    right = [Stated(p, bool(random.random() < p)).rank(random) for p in stated]
    wrong = [Stated(p, bool(random.random() < p**2)).rank(random) for p in stated]
    values = p_values({"right": right, "wrong": wrong})
    assert values["right"] > 0.01 > values["wrong"]


def test_a_bin_that_is_off_is_named() -> None:
    stated = np.repeat([0.05, 0.95], 200)
    fair = np.concatenate([np.arange(200) < 10, np.arange(200) < 190])
    off = np.concatenate([np.arange(200) < 10, np.arange(200) < 150])
    assert [row[3] for row in reliability(stated, fair)] == [True, True]
    assert [row[3] for row in reliability(stated, off)] == [True, False]


@pytest.mark.long
@pytest.mark.slow
def test_a_drawn_world_has_what_its_configuration_says() -> None:
    """Misses, false alarms and odometry, pooled over worlds."""
    base = configuration()
    always = replace(base, open_world=replace(base.open_world, detection_probabilities=(0.6,)))
    worlds = [drawn_world(always, 20, np.random.default_rng(seed)) for seed in range(40)]
    labels = [label for world in worlds for seen in world.detected for label in seen]
    false = sum(label < 0 for label in labels) / (40 * 20)
    assert false == pytest.approx(np.mean(base.open_world.clutters_per_frame), abs=0.15)  # two sigma of what is drawn
    clocks = np.array([world.biases for world in worlds])
    np.testing.assert_allclose(clocks.std(axis=0), [0.05, 0.05, 0.05, 0.2], rtol=0.35)
    assert all(keyframe.odometry_shifts is not None for keyframe in worlds[0].keyframes)


def test_ranges_of_a_drawn_world_may_be_depths_of_another_metre() -> None:
    base = configuration()
    exact = replace(
        base.perception, ranges_are=("depth",), sigma_range_m=1e-9, sigma_range_per_m=0.0, sigma_range_scale=0.1
    )
    ratios = []
    for seed in range(40):
        world = drawn_world(replace(base, perception=exact), 6, np.random.default_rng(seed))
        own = [
            measured / se2.between(pose, np.append(world.objects[label], 0.0))[0]
            for keyframe, labels, pose in zip(world.keyframes, world.detected, world.poses, strict=True)
            for measured, label in zip(keyframe.measurements.ranges_m, labels, strict=True)
            if label >= 0
        ]
        np.testing.assert_allclose(own, np.mean(own) if own else 1.0, atol=1e-6)
        ratios += own[:1]
    assert np.std(ratios) == pytest.approx(0.1, rel=0.4)


def test_what_is_called_within_the_prior_is_and_nothing_else() -> None:
    base = configuration()
    levels = set(base.odometry.noise_factors) & set(base.perception.noise_factors)
    greatest = max(*base.odometry.noise_factors, *base.perception.noise_factors)
    for name, truth in TRUTHS.items():
        allowed = [
            truth.noise is None or truth.noise**2 in levels,
            truth.correlated_share in (None, base.detection_errors.correlated_share),
            truth.outliers == base.detection_errors.outlier_share,
            truth.turn_rad_per_m is None or truth.turn_rad_per_m <= 2.0 * base.odometry.sigma_bias_rad_per_m,
        ]
        assert all(allowed) == (name == RIGHT or name in WITHIN_PRIOR)
    assert max(truth.noise or 0.0 for truth in TRUTHS.values()) ** 2 > greatest


@pytest.mark.parametrize(
    ("right", "outliers", "holds"),
    [
        (0.94, 0.91, [True, True]),
        (0.90, 0.91, [False, True]),
        (0.99, 0.91, [False, True]),
        (0.94, 0.89, [True, False]),
    ],
)
def test_regions_are_to_hold_as_often_as_stated_where_all_is_as_stated(
    right: float, outliers: float, holds: list[bool]
) -> None:
    result = {
        "rejected": [],
        "reliability": {},
        "region95_held": {RIGHT: right, "2 % outliers": outliers, "noise understated 2x": 0.95},
        "region95_held_sigma": {RIGHT: 0.01, "2 % outliers": 0.02, "noise understated 2x": 0.02},
    }
    claims = claims_of(result)[2:]
    assert [claim.holds for claim in claims] == holds
    assert "± 1.0%" in claims[0].measured and "noise understated 2x (within the prior) 95%" in claims[1].measured


@pytest.mark.long
@pytest.mark.slow
def test_the_study_leaves_result_and_page(tmp_path: Path) -> None:
    files = run(tmp_path, quick=True, jobs=1, seed=0)
    assert {file.name for file in files} == {"result.json", "result.html"}
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["num_worlds"] == {truth: 2 if truth == RIGHT else 1 for truth in TRUTHS}
    assert result["region95_held_sigma"].keys() == TRUTHS.keys()
    assert {"robot x", "robot yaw", "existence"} <= result["ranks"].keys()
    assert (tmp_path / "ranks.png").stat().st_size > 5000

"""How often a detector detects is learned from what runs have in view; the next run takes it, or stays as it was."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semantic_slam.class_models.detector import with_fitted_detection
from semantic_slam.configuration import (
    Configuration,
    OpenWorldConfiguration,
    SemanticModelConfiguration,
    from_dict,
    load_configuration,
)
from semantic_slam.errors import InputError
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.shipped import configuration_file
from semantic_slam.training.detection.evidence import RunLooks, log_evidence
from semantic_slam.training.detection.looks import NUM_DIRECTIONS, Looks
from semantic_slam.training.detection.rates import grid, learned
from semantic_slam.training.labels.report import detection_lines
from semantic_slam.viewpoint.detection_values import DetectionValues
from semantic_slam.viewpoint.labels.confusion import Confusion
from semantic_slam.viewpoint.labels.settings import LabelSettings
from semantic_slam.viewpoint.labels.store import FittedBag, FittedLabels, read_labels, save_labels

AS_TOLD = OpenWorldConfiguration(detection_probability=0.9)


def looks(seed: int, probability: float, half_range_m: float, keyframes: int = 60, objects: int = 8) -> Looks:
    """All in view all the time, at distances that are drawn anew, straight ahead."""
    random = np.random.default_rng(seed)
    ranges = random.uniform(0.5, 5.0, (keyframes, objects))
    return Looks(
        weights=np.ones(objects),
        is_known=np.ones((keyframes, objects), dtype=bool),
        is_detected=random.random((keyframes, objects)) < probability * 2.0 ** -((ranges / half_range_m) ** 2),
        in_view=np.ones((keyframes, objects)),
        ranges_m=ranges,
        off_centre_rad=np.zeros((keyframes, objects)),
        field_of_view_rad=AS_TOLD.field_of_view_rad,
    )


def looks_to_the_right(seed: int, keyframes: int = 60, objects: int = 8) -> Looks:
    """From all over the field of view, of which the right half detects a third as often as the left one."""
    random = np.random.default_rng(seed)
    off_centre = AS_TOLD.field_of_view_rad * random.uniform(-0.5, 0.5, (keyframes, objects))
    detected = random.random((keyframes, objects)) < np.where(off_centre < 0.0, 0.3, 0.9)
    return replace(looks(0, 0.9, np.inf, keyframes, objects), is_detected=detected, off_centre_rad=off_centre)


def test_the_evidence_of_independent_misses_is_that_of_coins() -> None:
    seen = looks(0, 0.7, 3.0)
    rates = grid()
    (row,) = np.flatnonzero((rates.probability == 0.7) & (rates.half_range_m == 3.0) & (rates.persistence == 0.0))
    chance = 0.7 * 2.0 ** -((seen.ranges_m / 3.0) ** 2)
    exact = np.where(seen.is_detected, np.log(chance), np.log1p(-chance)).sum(axis=1)
    np.testing.assert_allclose(log_evidence(seen, rates)[:, row], exact)


def test_misses_that_come_in_runs_have_the_evidence_of_the_sum_over_what_was_detectable() -> None:
    """Two looks at one object, the first of which misses: the sum over the chain's states, written out."""
    rates = DetectionRates.of(replace(AS_TOLD, detection_probability=0.6, miss_persistence=0.5))
    (share,), (hit,) = rates.runs.share, rates.runs.hit
    seen = replace(looks(0, 0.6, np.inf, keyframes=2, objects=1), is_detected=np.array([[False], [True]]))
    first = share + 0.5 * (1.0 - share)  # it was detectable when it was detected first
    missed = first * (1.0 - hit) + 1.0 - first
    after = first * (1.0 - hit) / missed
    exact = [np.log(missed), np.log(hit * (share + 0.5 * (after - share)))]
    np.testing.assert_allclose(log_evidence(seen, rates)[:, 0], exact)


def test_a_detector_that_sees_less_far_off_is_told_from_its_looks() -> None:
    found = learned([looks(seed, 0.8, 4.0) for seed in range(3)], AS_TOLD, 5)
    assert found.is_kept and found.alike > found.before + 100.0
    assert found.values == DetectionValues(probability=0.8, half_range_m=4.0, persistence=0.0)
    assert len(found.without) == 3 and all(own.half_range_m == 4.0 for own in found.without)


@pytest.mark.long
def test_a_detector_that_sees_less_to_one_side_is_told_from_its_looks() -> None:
    found = learned([looks_to_the_right(seed) for seed in range(3)], AS_TOLD, 5)
    assert found.by_direction is not None and found.by_direction > found.alike + 30.0
    shares = np.array(found.values.by_direction)
    assert np.all(shares[: NUM_DIRECTIONS // 2] <= 0.5) and np.all(shares[NUM_DIRECTIONS // 2 + 1 :] >= 0.8)
    assert found.values.probability == pytest.approx(0.9, abs=0.06) and found.values.half_range_m is None
    assert all(own.by_direction for own in found.without)


def test_shares_of_directions_have_the_evidence_of_coins() -> None:
    seen, shares = looks_to_the_right(1), np.linspace(0.2, 1.0, NUM_DIRECTIONS)
    rates = DetectionRates.of(AS_TOLD)
    chance = 0.9 * np.interp(seen.off_centre_rad, AS_TOLD.field_of_view_rad * np.linspace(-0.5, 0.5, 7), shares)
    exact = np.where(seen.is_detected, np.log(chance), np.log1p(-chance)).sum(axis=1)
    np.testing.assert_allclose(log_evidence(seen, rates, shares[:, None])[:, 0], exact)
    configured = DetectionRates.of(replace(AS_TOLD, detection_by_direction=tuple(shares)))
    np.testing.assert_allclose(log_evidence(seen, configured)[:, 0], exact)


def test_a_detector_as_it_was_told_stays_so() -> None:
    found = learned([looks(1, 0.9, np.inf, keyframes=20), None], AS_TOLD, 5)
    assert not found.is_kept and found.without == (DetectionValues(), DetectionValues())


@pytest.mark.long
def test_directions_are_told_apart_only_where_that_is_better_than_all_alike() -> None:
    even = [replace(looks_to_the_right(seed), is_detected=looks(seed, 0.6, np.inf).is_detected) for seed in range(3)]
    found = learned(even, AS_TOLD, 5)
    assert found.is_kept and found.values.by_direction == () and found.values.field_of_view_rad is None


def test_directions_of_several_fields_of_view_are_not_told_apart() -> None:
    wide, narrow = looks_to_the_right(0), replace(looks_to_the_right(1), field_of_view_rad=0.5)
    assert RunLooks(runs=[wide, None], num_stretches=5).of_one_view
    assert not RunLooks(runs=[wide, narrow], num_stretches=5).of_one_view
    found = learned([wide, narrow], AS_TOLD, 5)
    assert found.is_kept and found.values.by_direction == () and found.by_direction is None
    (line,) = detection_lines({**found.numbers, "runs": 2, "runs_in_space": 0})
    assert "taken to be alike in all directions;" in line and "not compared, as the fields of view of the runs" in line
    assert "by direction" not in line


def test_what_is_to_be_inferred_or_told_of_detection_leaves_out_all_that_was_fitted(tmp_path: Path) -> None:
    settings = SemanticModelConfiguration(kind="detector", labels=("cup",), path=str(tmp_path / "models.safetensors"))
    save_labels(fitted_labels(DetectionValues(probability=0.7, half_range_m=4.0, persistence=0.5)), Path(settings.path))
    for told in (
        replace(AS_TOLD, miss_persistences=(0.0, 0.9)),
        replace(AS_TOLD, detection_half_ranges_m=(3.0,)),
        replace(AS_TOLD, detection_by_direction=(0.5, 1.0, 0.5)),
    ):
        assert with_fitted_detection(told, settings, "cd") == told


def fitted_labels(detection: DetectionValues, *bags: FittedBag) -> FittedLabels:
    """Of a detector with one label."""
    return FittedLabels(
        labels=("cup",),
        settings=LabelSettings.grid((0.0,), (0.5,), (1.0,)).take(np.array([0])),
        confusions=(Confusion.symmetric(1, 0.8, 4.0, 0.05),) * (1 + len(bags)),
        class_shares=np.array([0.5, 0.5]),
        bags=bags,
        report={},
        detection=detection,
    )


def test_a_run_takes_what_was_learned_without_its_own_bag(tmp_path: Path) -> None:
    bag = FittedBag(
        path="bag", sha256="ab", stretch_edges_ns=(0, 1), log_settings=(0.0,), class_shares=(0.5, 0.5),
        detection=DetectionValues(probability=0.6),
    )  # fmt: skip
    fitted = fitted_labels(
        DetectionValues(
            probability=0.7, half_range_m=4.0, persistence=0.5, by_direction=(0.5, 1.0, 0.5), field_of_view_rad=1.4
        ),
        bag,
    )
    path = tmp_path / "models.safetensors"
    save_labels(fitted, path)
    assert read_labels(path).detection == fitted.detection
    settings = SemanticModelConfiguration(kind="detector", labels=("cup",), path=str(path))
    other = with_fitted_detection(AS_TOLD, settings, "cd")
    assert other.detection_probabilities == (0.7,) and other.detection_half_ranges_m == (4.0,)
    assert other.detection_by_direction == (0.5, 1.0, 0.5)
    narrow = with_fitted_detection(replace(AS_TOLD, field_of_view_rad=0.7), settings, "cd")
    assert narrow.detection_by_direction == (0.75, 1.0, 0.75)
    assert with_fitted_detection(AS_TOLD, settings, "ab") == replace(AS_TOLD, detection_probabilities=(0.6,))
    asked = replace(AS_TOLD, detection_probabilities=(0.5, 0.9))
    assert with_fitted_detection(asked, settings, "cd").detection_probabilities == (0.5, 0.9)
    save_labels(replace(fitted, detection=DetectionValues(probability=1.5)), path)
    with pytest.raises(InputError, match="a detection probability must lie between 0 and 1"):
        read_labels(path)


def test_directions_that_were_fitted_in_the_plane_are_refused_in_space_as_configured_ones_are(tmp_path: Path) -> None:
    path = tmp_path / "models.safetensors"
    told = DetectionValues(probability=0.7, by_direction=(0.5, 1.0, 0.5), field_of_view_rad=1.0)
    shipped = load_configuration(configuration_file("spatial"))
    models = replace(shipped.semantic_model, labels=("cup",), path=str(path))
    fixed = replace(shipped, semantic_model=models, open_world=replace(shipped.open_world, detection_probabilities=()))
    save_labels(fitted_labels(told), path)
    with pytest.raises(InputError, match="tells detection rates by direction, which state_space: spatial does not"):
        announced(fixed)
    inferred = replace(fixed, open_world=shipped.open_world)
    assert announced(inferred).open_world.detection_probabilities == shipped.open_world.detection_probabilities
    save_labels(fitted_labels(replace(told, by_direction=(), field_of_view_rad=None)), path)
    assert announced(fixed).open_world.detection_probabilities == (0.7,)


def announced(configuration: Configuration) -> Configuration:
    """The configuration of a run as backends get it."""
    run = make_run_configuration(configuration, None, *initial_pose_of(configuration), stamp_ns=0)
    return from_dict(json.loads(run.configuration))

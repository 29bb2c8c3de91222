"""The study of photographs: which views train, which objects look alike, and what its claims compare."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.studies.real_turntables.claims import claims_of
from semantic_slam_lab.studies.real_turntables.latent_models import Parts
from semantic_slam_lab.studies.real_turntables.latent_scores import share_inside, told_by_nearest
from semantic_slam_lab.studies.real_turntables.lookalikes import drawn, lookalike_pairs
from semantic_slam_lab.studies.real_turntables.measurement import trained_measurement
from semantic_slam_lab.studies.real_turntables.photographs import Photographs, collected, read_photographs
from semantic_slam_lab.studies.real_turntables.tracks import NUM_VIEWS, tracks_of

from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.training.views import ObjectView

NAMES = tuple("abcdefg")
CUTOUT, MASK = np.zeros((4, 4, 3), dtype=np.uint8), np.full((4, 4), 255, dtype=np.uint8)


def view(name: str, angle: int) -> ObjectView:
    return ObjectView(name, float(wrap_angle(np.deg2rad(angle))), 0.0, 1.0, CUTOUT, MASK, angle)


def photographs(*missing: tuple[str, int]) -> Photographs:
    views = [view(name, angle) for name in NAMES for angle in range(0, 360, 5) if (name, angle) not in missing]
    return collected(views, Path("photographs"))


def angles(own: Photographs, rows: np.ndarray) -> set[int]:
    return {own.views[row].angle_deg for row in rows}


def test_views_every_twenty_degrees_train_and_a_missing_one_gives_way_to_its_neighbour() -> None:
    own = photographs(("a", 40))
    assert angles(own, own.training("b")) == set(range(0, 360, 20))
    assert len(angles(own, own.training("a")) & {35, 45}) == 1
    assert not angles(own, own.others("b")) & set(range(0, 360, 20))
    assert angles(own, own.front(own.training("b"))) == {0, 20, 40, 60, 80, 280, 300, 320, 340}


def write_photographs(root: Path, suffix: str) -> None:
    """Six objects from four sides, before white but for a stripe; their masks leave the stripe out."""
    for name in NAMES[:6]:
        for folder in (root / name, root / name / "maps"):
            folder.mkdir(parents=True, exist_ok=True)
        for angle in (0, 90, 180, 270):
            picture, mask = np.full((40, 60, 3), 255, dtype=np.uint8), np.zeros((40, 60), dtype=np.uint8)
            picture[10:30, 10:30], mask[10:30, 10:30] = 60, 255
            picture[10:30, 40:50] = 60
            cv2.imwrite(str(root / name / f"{angle}{suffix}"), picture)
            cv2.imwrite(str(root / name / "maps" / f"{angle}.png"), mask)


def test_a_folder_of_other_names_is_read_by_its_pattern_and_masks(tmp_path: Path) -> None:
    write_photographs(tmp_path, ".bmp")
    own = read_photographs(tmp_path, "{object}/{azimuth}.bmp", "{object}/maps/{azimuth}.png")
    assert own.names == tuple("abcdef")
    assert angles(own, own.of("c")) == {0, 90, 180, 270}
    assert all(each.cutout.shape == (20, 20, 3) for each in own.views)  # without masks the stripe belongs to it
    with pytest.raises(InputError, match=r"none of 48 files is '\{object\}__\{azimuth\}\.jpg'"):
        read_photographs(tmp_path)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("ch3_localization", "--pattern", "{object}__{azimuth}.png"), "ch3_localization has no option --pattern"),
        (("real_cabinet", "--mask-pattern", "{object}.png"), "real_cabinet has no option --mask-pattern"),
        (("real_turntables", "--mask-pattern", "{object}.png"), "--mask-pattern: only with --pattern"),
        (("novelty", "--pattern", "{name}.png"), r"no field \{name\}"),
    ],
)
def test_a_pattern_that_cannot_be_used_is_refused(
    words: tuple[str, ...], fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "photographs"
    folder.mkdir()
    photographs = ["--data", str(folder)] if words[0] != "ch3_localization" else []
    monkeypatch.setattr("sys.argv", ["run_study", *words, *photographs, "--out", str(tmp_path / "out")])
    with pytest.raises(InputError, match=fault):
        run_study.command()


def test_too_few_objects_are_bad_input() -> None:
    with pytest.raises(InputError, match="5 objects"):
        collected([view(name, 0) for name in NAMES[:5]], Path("photographs"))


def test_the_pair_that_shares_a_view_looks_most_alike_and_is_in_a_draw() -> None:
    own = photographs()
    pooled = np.random.default_rng(0).normal(size=(len(own.views), 40))
    pooled[own.of("f")[36]] = pooled[own.of("c")[36]]
    pairs = lookalike_pairs(own, pooled)
    assert pairs[0].names == ("c", "f")
    assert pairs[0].similarity == pytest.approx(1.0)
    draws = drawn(own, pairs, 12, seed=0)
    assert draws[0].names[:2] == draws[10].names[:2] == ("c", "f")
    assert all(len(set(draw.names)) == 5 for draw in draws)
    assert draws == drawn(own, pairs, 12, seed=0)


def test_a_track_goes_around_one_object_along_views_that_train_nothing() -> None:
    own = photographs()
    pairs = lookalike_pairs(own, np.random.default_rng(0).normal(size=(len(own.views), 8)))
    for track in tracks_of(own, drawn(own, pairs, 1, seed=3)[0], seed=3):
        assert len(set(own.instance[track.rows])) == 1
        assert not angles(own, track.rows) & set(range(0, 360, 20))
        assert track.cluttered.sum() == NUM_VIEWS // 2
        np.testing.assert_allclose(np.linalg.norm(track.places_m, axis=1), 1.0)


def test_a_nearest_neighbour_tells_what_turns_and_not_what_looks_the_same() -> None:
    own = photographs()
    layout = np.stack([np.cos(own.azimuth_rad), np.sin(own.azimuth_rad)], axis=1)
    layout[own.of("a")] = 1.0
    train = np.array([row for row, each in enumerate(own.views) if each.angle_deg % 10 == 0])
    told = told_by_nearest(own, layout, train, np.setdiff1d(np.arange(len(own.views)), train))
    assert told["b"] == 1.0
    assert told["a"] < 0.2


def test_parts_without_instances_have_none_of_their_views() -> None:
    own = photographs()
    rows = np.arange(len(own.views))
    left = Parts(NAMES, rows[::2], rows[1::2]).without(own, ("a", "d"))
    assert left.known == ("b", "c", "e", "f", "g")
    assert {own.views[row].class_name for row in (*left.train, *left.calibrate)} == set(left.known)


def test_dropout_of_the_head_is_keyed() -> None:
    generator = np.random.default_rng(5)
    labels = np.arange(50) % 5
    pooled = np.eye(5)[labels] + 0.1 * generator.normal(size=(50, 5))
    head = trained_measurement(pooled, labels, 5, seed=0)
    samples = head.samples(pooled[3], ("view", 3))
    np.testing.assert_array_equal(samples, head.samples(pooled[3], ("view", 3)))
    assert samples.std(axis=0).max() > 0.0
    assert samples.mean(axis=0).argmax() == labels[3]


@pytest.mark.parametrize(("nees", "is_calibrated"), [(1.0, True), (1.4, False), (0.5, False)])
def test_an_azimuth_that_is_too_sure_or_not_sure_enough_is_seen_in_lots_of_one_view_per_object(
    nees: float, is_calibrated: bool
) -> None:
    """Pools of 36 objects, 18 views each, errors of one object correlated by 0.3; the claim may err in one of eight."""
    held = []
    for seed in range(16):
        generator = np.random.default_rng(seed)
        errors = np.sqrt(0.3) * generator.normal(size=(36, 1)) + np.sqrt(0.7) * generator.normal(size=(36, 18))
        pool = nees * errors**2
        own = latent(nees=pool.mean(), nees_one_view_in_band=share_inside(list(pool), generator))
        (claim,) = (claim for claim in claims_of(outcome(own)) if claim.text.startswith("MAP: azimuth NEES"))
        held.append(claim.holds)
    assert np.mean(np.array(held) == is_calibrated) >= 0.875


def latent(**numbers: float) -> dict[str, Any]:
    """A latent model's numbers."""
    return {
        **{"peak_within_10deg": 0.96, "objects_told": 36, "nees": 1.0, "nees_band": [0.5927, 1.5121]},
        **{"nees_one_view_in_band": 0.95, "new_nees": 20.0, "new_nees_widened": 1.2, "new_objects": 2.0},
        "objects": {"a": {"can_be_told": False}},
        **numbers,
    }


def outcome(own: dict[str, Any], classified: dict[str, dict[str, float]] | None = None) -> dict[str, Any]:
    """A result whose latent models are both ``own``."""
    return {
        "classification": {"model": classified or methods(1.0, 0.0, 0.0)},
        "ambiguity": [{"pair": "a / b", "front": 0.0, "behind": 0.4}],
        "latent": {"map": own, "energy": own},
    }


def methods(final: float, ours: float, theirs: float) -> dict[str, dict[str, float]]:
    columns = ("log_mgr_final_p75", "log_mgr_final_p95", "log_mgr_overall_p75", "log_mgr_overall_p95")
    values = {"ours": ours, "model_based": theirs, "simple_bayes": theirs}
    return {name: {"correct_rate_final": final, **dict.fromkeys(columns, mgr)} for name, mgr in values.items()}


@pytest.mark.parametrize(
    ("final", "ours", "theirs", "held"),
    [
        (1.0, 0.0, 0.0, [True, True, True, True]),
        (0.9, 2.0, 30.0, [False, True, True, True]),
        (0.96, 2.0, 1.0, [True, False, False, False]),
    ],
)
def test_claims_compare_with_model_based(final: float, ours: float, theirs: float, held: list[bool]) -> None:
    claims = claims_of(outcome(latent(nees_one_view_in_band=0.89), methods(final, ours, theirs)))
    assert [claim.holds for claim in claims[:4]] == held
    assert [claim.holds for claim in claims[4:]] == [True, True, False, True, True, False, True]

"""Hypotheses of other kinds, elsewhere or of other noises, are not crowded out by variants of the best one."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior, ObjectPrior
from semantic_slam.configuration import PruningConfiguration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.building.checks import check_settings
from semantic_slam.inference.pruning import Kinds, Pruned, affordable, most_of_a_kind, prune, shared_out
from semantic_slam.shipped import CONFIGURATIONS

WEIGHTS = np.log([8.0, 4.0, 2.0, 1.0, 0.5, 1e-5])
POSITIONS = np.array([[0.0, 0.0], [0.1, 0.0], [5.0, 0.0], [0.2, 0.0], [5.0, 0.1], [9.0, 9.0]])


def pruned(kinds: Kinds | None = None, ordinary: list[bool] | None = None, **limits: float) -> Pruned:
    settings = PruningConfiguration(
        **{"ratio": 10.0, "max_hypotheses": 4, "place_m": 1.0, "kind_ratio": 100.0, **limits}
    )
    told = None if ordinary is None else np.array(ordinary)
    return prune(WEIGHTS, np.arange(6, dtype=np.uint64), np.array([-np.inf]), settings, kinds, told)


def kinds(root_numbers: tuple[int, ...] = (0,) * 6, positions: np.ndarray = POSITIONS) -> Kinds:
    return Kinds(positions=positions, root_numbers=np.array(root_numbers))


def test_half_of_the_room_goes_in_turn_to_each_kind() -> None:
    """Of three at most: one slot in turn, which the heaviest has; of five, two, the second for the other place."""
    assert pruned(kinds(), max_hypotheses=2).kept.tolist() == [0, 1]
    assert pruned(kinds(positions=POSITIONS[[0, 1, 1, 3, 2, 5]]), max_hypotheses=4).kept.tolist() == [0, 1, 2, 4]


def test_what_began_otherwise_is_of_another_kind_wherever_it_is() -> None:
    at_one_place = np.zeros((6, 2))
    assert pruned(kinds((0, 0, 0, 0, 1, 1), at_one_place)).kept.tolist() == [0, 1, 2, 4]


def test_posterior_modes_of_a_robot_on_a_known_map_are_of_one_kind() -> None:
    """A lost robot's first detection has several modes, which only at the first keyframe of an open world are roots."""
    row = MapPrior(tuple(ObjectPrior.planar(n, 2.0 * n, 1.0, sigma_m=0.1, sigma_rad=0.1) for n in range(4)))
    live = []
    for place_m in (0.0, 1000.0):  # without kinds; with one place for all
        pruning = {"ratio": 100.0, "kind_ratio": 1e6, "place_m": place_m}
        engine = Engine(
            Configuration.of(semantic_model={"kind": "none"}, pruning=pruning),
            row,
            initial_pose=(3.0, 0.0, 0.0),
            initial_covariance=np.diag([4.0, 2.25, 2.25]),
        )
        for k in range(2):
            seen = [Detection(range_m=2.2, bearing_rad=0.5)]
            engine.process(Keyframe.planar(k, motion=(0.3 * k, 0.0, 0.0), detections=seen))
        live.append(list(engine.live))
    assert len({history.lineage[0].mode for history in engine.live.values()}) > 1
    assert live[0] == live[1]


def test_what_is_of_a_kind_is_held_against_the_heaviest_of_that_kind() -> None:
    """0.5 of 2 at the other place, while 0.5 of 8 would have been too little, and 1e-5 of 8 is for any kind."""
    assert pruned(kinds(), max_hypotheses=6).kept.tolist() == [0, 1, 2, 3, 4]
    assert pruned(max_hypotheses=6).kept.tolist() == [0, 1, 2, 3]
    assert pruned(kinds(), max_hypotheses=6, kind_ratio=1e7).kept.tolist() == [0, 1, 2, 3, 4, 5]


def test_hypotheses_of_a_kind_beyond_its_limit_count_as_discarded() -> None:
    """Of three at one place and two at another, with room for all."""
    assert pruned(replace(kinds(), most=2), max_hypotheses=6).kept.tolist() == [0, 1, 2, 4]
    found = pruned(replace(kinds(), most=1), max_hypotheses=6)
    assert found.kept.tolist() == [0, 2]
    assert found.discarded == pytest.approx((4.0 + 1.0 + 0.5 + 1e-5) / np.exp(WEIGHTS).sum())


@pytest.mark.parametrize(("pairs", "detections", "most"), [(0, 20, None), (60, 0, 60), (60, 20, 3), (60, 100, 1)])
def test_the_more_is_in_sight_the_fewer_of_a_kind_are_kept(pairs: int, detections: int, most: int | None) -> None:
    assert most_of_a_kind(PruningConfiguration(max_pairs=pairs), detections) == most


def test_a_limit_of_pairs_is_refused_where_there_are_no_kinds() -> None:
    shipped = load_configuration(CONFIGURATIONS / "uncalibrated.yaml")
    assert shipped.pruning.max_pairs > 0
    check_settings(shipped, strategy_of(shipped))
    without = replace(shipped, pruning=replace(shipped.pruning, place_m=0.0))
    with pytest.raises(InputError, match=r"max_pairs .* needs pruning.place_m above 0; set it, or max_pairs to 0"):
        check_settings(without, strategy_of(without))
    ever = replace(without, pruning=replace(without.pruning, max_pairs=0))
    check_settings(ever, strategy_of(ever))


@pytest.mark.parametrize("limits", [{"place_m": 0.0}, {"max_hypotheses": 1}])
def test_without_a_place_or_room_the_heaviest_are_kept(limits: dict[str, float]) -> None:
    np.testing.assert_array_equal(pruned(kinds(), **limits).kept, pruned(**limits).kept)


@pytest.mark.parametrize("place_m", [0.0, 1.0])
def test_of_ordinary_histories_the_heaviest_is_kept_longer_than_others_are(place_m: float) -> None:
    """1e-5 and 0.5 of 8: too little for any other; not beyond the ratio of kinds, nor where one of them is kept."""
    rare = {"place_m": place_m, "max_hypotheses": 3}
    together = kinds(positions=np.zeros((6, 2)))
    assert pruned(together, [False] * 4 + [True] * 2, **rare).kept.tolist() == [0, 1, 4]
    assert pruned(together, [False] * 5 + [True], **rare).kept.tolist() == [0, 1, 2]
    assert pruned(together, [False] * 5 + [True], kind_ratio=1e6, **rare).kept.tolist() == [0, 1, 5]
    assert pruned(together, [False, True, False, False, True, False], **rare).kept.tolist() == [0, 1, 2]


def test_what_is_given_up_counts_as_discarded_whatever_kind_it_is_of() -> None:
    total = np.exp(WEIGHTS).sum()
    found = pruned(kinds((0, 0, 0, 0, 1, 1), np.zeros((6, 2))))
    assert found.discarded == pytest.approx((1.0 + 1e-5) / total)
    assert np.exp(found.log_weights).sum() == pytest.approx(1.0)


def test_what_a_revision_finds_takes_the_room_of_no_other_kind() -> None:
    """Of seven rows four stay: two in turn, of which one is of the second kind, and then the heaviest."""
    assert shared_out(np.array([0, 0, 0, 0, 1, 0, 2]), 4).tolist() == [0, 1, 2, 4]
    assert shared_out(np.array([0, 0, 1]), 4).tolist() == [0, 1, 2]


@pytest.mark.parametrize(("keyframes", "kept"), [(1, 40), (300, 40), (600, 20), (3000, 4), (50_000, 1)])
def test_as_many_hypotheses_are_followed_as_have_so_many_poses_together(keyframes: int, kept: int) -> None:
    limits = PruningConfiguration(max_hypotheses=40, max_poses=12_000)
    assert affordable(limits, keyframes).max_hypotheses == kept
    assert affordable(PruningConfiguration(max_hypotheses=40), keyframes).max_hypotheses == 40

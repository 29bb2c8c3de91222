"""What a map has elsewhere: weighed as an object about its place on the map, in its stead."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from worlds.drives.standing_robot import beliefs_at_rest
from worlds.exact.object_quadrature import ObjectQuadrature

from semantic_slam.configuration import Configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.world.displaced_objects import with_displaced
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

PLACES, SIGMA_MAP = np.array([[3.0, 0.8], [2.6, -0.9]]), 0.15
SHARE, SIGMA, CLUTTER = 0.05, 1.0, 0.02
IDS = (4, 7)
MAP = MapPrior(
    tuple(ObjectPrior.planar(n, *place, sigma_m=SIGMA_MAP, sigma_rad=0.1) for n, place in zip(IDS, PLACES, strict=True))
)


def _configuration(share: float = SHARE) -> Configuration:
    return Configuration.of(
        semantic_model={"kind": "none"},
        closed_world={"clutter_per_frame": CLUTTER, "displaced_share": share, "displaced_sigma_m": SIGMA},
        pruning={"ratio": 1e15, "max_hypotheses": 4000},
        weights={"gate": 60.0, "max_candidates": 4000},
    )


def _run(
    frames: Sequence[Sequence[Detection]], configuration: Configuration, backends: int = 1, sigma: float = 1e-5
) -> list[HybridBelief]:
    """Of a robot that stands at the origin, which it knows to ``sigma``."""
    return beliefs_at_rest(frames, configuration, MAP, backends, sigma)


def _log_clutter(seen: Detection) -> float:
    region = Configuration().open_world
    area = 0.5 * region.field_of_view_rad * (region.max_range_m**2 - region.min_range_m**2)
    assert seen.range_m is not None
    return float(np.log(CLUTTER * seen.range_m / area))


def _exact(frames: Sequence[Sequence[Detection]]) -> tuple[np.ndarray, np.ndarray]:
    """Probability that each object was moved, and the mean of its place: all histories, all sets of moved objects."""
    quadrature, flat = ObjectQuadrature(), [(k, i) for k, own in enumerate(frames) for i in range(len(own))]
    wide = float(np.hypot(SIGMA_MAP, SIGMA))
    known: dict[tuple[int, bool, tuple[tuple[int, int], ...]], tuple[float, np.ndarray]] = {}
    weight, moved, mean = 0.0, np.zeros(2), np.zeros((2, 2))
    for labels in product((0, 1, -1), repeat=len(flat)):
        pairs = [(k, label) for (k, _), label in zip(flat, labels, strict=True) if label >= 0]
        if len(set(pairs)) < len(pairs):
            continue
        log_clutter = sum(_log_clutter(frames[k][i]) for (k, i), n in zip(flat, labels, strict=True) if n < 0)
        for away in product((False, True), repeat=2):
            own, places = np.exp(log_clutter), []
            for number, is_moved in enumerate(away):
                seen = tuple(at for at, label in zip(flat, labels, strict=True) if label == number)
                key = (number, is_moved, seen)
                if key not in known:
                    known[key] = quadrature.moments(
                        PLACES[number], wide if is_moved else SIGMA_MAP, [frames[k][i] for k, i in seen]
                    )
                own *= known[key][0] * (SHARE if is_moved else 1.0 - SHARE)
                places.append(known[key][1])
            weight, moved, mean = weight + own, moved + own * np.array(away), mean + own * np.array(places)
    return moved / weight, mean / weight


@pytest.mark.long
@pytest.mark.slow
def test_what_was_moved_and_where_it_is_are_those_of_all_histories_and_all_sets_of_moved_objects() -> None:
    elsewhere = PLACES[0] + [0.5, 0.2]
    frames = [
        [Detection.at(*elsewhere), Detection.at(*(PLACES[1] + [0.05, 0.02]))],
        [Detection.at(*(PLACES[1] + [-0.04, 0.1])), Detection.at(*np.add(elsewhere, [0.03, -0.05]))],
    ]
    belief = _run(frames, _configuration())[-1]
    moved, places = _exact(frames)
    assert belief.object_ids.tolist() == list(IDS) and 0.2 < moved[0] < 0.98
    np.testing.assert_allclose(belief.moved, moved, atol=0.01)
    np.testing.assert_allclose(belief.object_poses[:, :2], places, atol=0.01)
    np.testing.assert_allclose(belief.existence, 1.0, atol=1e-9)


def test_what_was_not_seen_was_moved_as_often_as_any_object_is() -> None:
    belief = _run([[Detection.at(*PLACES[0])]], _configuration())[-1]
    assert belief.moved[1] == pytest.approx(SHARE, abs=1e-3) and belief.moved[0] < SHARE


def test_what_stands_a_metre_off_is_named_where_it_is_and_does_not_pull_the_robot() -> None:
    displaced = PLACES[0] + [0.8, 0.6]
    frames = [[Detection.at(*displaced), Detection.at(*PLACES[1])]] * 4
    said, unsaid = (_run(frames, _configuration(share), sigma=0.3)[-1] for share in (SHARE, 0.0))
    assert said.moved[0] > 0.9 and said.moved[1] < SHARE and np.isnan(unsaid.moved).all()
    np.testing.assert_allclose(said.object_poses[0, :2], displaced, atol=0.15)
    assert np.hypot(*said.poses[0, :2]) < 0.5 * np.hypot(*unsaid.poses[0, :2])


@pytest.mark.parametrize("common", [0.3, 1.0])
@pytest.mark.parametrize("moved", [[0.0, 0.0], [0.0, 0.7]])
def test_what_was_moved_is_told_from_a_map_that_is_off_as_a_whole(common: float, moved: list[float]) -> None:
    """All of a map's places have an error in common, as a FILE.map states it, which moves nothing on the map."""
    places = np.array([[3.0, 1.5], [3.0, -1.5], [4.5, 0.5], [2.0, 0.0]])
    count, own, share = len(places), 0.05, np.diag([common**2, common**2, 0.0])
    items = [ObjectPrior.planar(n, *at, sigma_m=np.hypot(own, common), sigma_rad=0.1) for n, at in enumerate(places)]
    joint = np.kron(np.eye(count), np.diag([own**2, own**2, 0.01])) + np.kron(np.ones((count, count)), share)
    seen = places + np.array([common, 0.0])
    seen[0] += moved
    frames = [[Detection.at(*at, covariance=0.05**2 * np.eye(2)) for at in seen]] * 3
    quick = replace(_configuration(), pruning=Configuration().pruning)
    belief = beliefs_at_rest(frames, quick, MapPrior(tuple(items), joint_covariance=joint))[-1]
    assert (belief.moved[0] > 0.98) == any(moved)
    assert belief.moved[1:].max() < 0.01 and (any(moved) or belief.moved[0] < 0.01)
    np.testing.assert_allclose(belief.object_poses[:, :2], seen, atol=0.1)


def test_no_history_has_an_object_at_two_places() -> None:
    twice = [[Detection.at(*PLACES[0]), Detection.at(*(PLACES[0] + [0.8, 0.6]))]] * 2
    for belief in _run(twice, _configuration()):
        both = (belief.associations[:, 0] == 0) & (belief.associations[:, 1] == 0)
        assert not both.any()


def test_without_clutter_as_many_detections_as_there_are_objects_are_of_objects() -> None:
    places = [(3.0, 0.26, 0.9), (2.75, -0.33, 0.8), (4.0, 0.0, 0.3)]
    seen = [Detection(range_m=r, bearing_rad=b, score=score) for r, b, score in places]
    configuration = _configuration()
    silent = replace(configuration, closed_world=replace(configuration.closed_world, clutter_per_frame=0.0))
    (belief,) = _run([seen], silent)
    assert [n >= 0 for n in belief.associations[0]] == [True, True, False]


def test_a_map_of_which_nothing_was_moved_stays_as_it_is() -> None:
    assert with_displaced(MAP, 0.0, SIGMA, 9)[0] is MAP
    wider, displaced = with_displaced(MAP, SHARE, SIGMA, 9)
    assert displaced.partner == {4: 9, 9: 4, 7: 10, 10: 7}
    assert [item.existence for item in wider.objects] == [1.0 - SHARE] * 2 + [SHARE] * 2


def test_backends_agree_on_what_was_moved_to_the_bit() -> None:
    frames = [[Detection.at(*(PLACES[0] + [0.4, 0.3])), Detection.at(*PLACES[1])]] * 2
    one, three = (_run(frames, _configuration(), backends) for backends in (1, 3))
    for own, other in zip(one, three, strict=True):
        np.testing.assert_array_equal(own.log_weights, other.log_weights)
        np.testing.assert_array_equal(own.moved, other.moved)
        np.testing.assert_array_equal(own.object_poses, other.object_poses)

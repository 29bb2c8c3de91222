"""An object that stands elsewhere and is named by its detections: one moved object against many wrong names."""

from collections.abc import Sequence
from itertools import product

import numpy as np
import pytest
from worlds.drives.standing_robot import beliefs_at_rest
from worlds.exact.object_quadrature import ObjectQuadrature

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

PLACES, SIGMA_MAP = np.array([[3.0, 0.8], [2.6, -0.9]]), 0.15
NAMES = ("cup", "chair")
SHARE, SIGMA = 0.05, 1.0
MAP = MapPrior(
    tuple(
        ObjectPrior.planar(n, *place, sigma_m=SIGMA_MAP, sigma_rad=0.1, name=name)
        for n, place, name in zip((4, 7), PLACES, NAMES, strict=True)
    )
)
FAR = np.add(PLACES[0], [0.9, 1.2])


def _named(*places: Sequence[float]) -> list[Detection]:
    """Detections of the mapped objects, in their order, under their names."""
    return [Detection.at(*place, track_id=name) for place, name in zip(places, NAMES, strict=False)]


def _run(
    frames: Sequence[Sequence[Detection]],
    wrong: float = 0.005,
    share: float = SHARE,
    sigma: float = 1e-5,
    backends: int = 1,
    known: MapPrior = MAP,
    **world: bool,
) -> list[HybridBelief]:
    """Beliefs of a robot that stands at the origin, which it knows to ``sigma``."""
    configuration = Configuration.of(
        association="given",
        semantic_model={"kind": "none"},
        closed_world={"wrong_identity_share": wrong, "displaced_share": share, "displaced_sigma_m": SIGMA},
        pruning={"ratio": 1e15, "max_hypotheses": 4000},
        weights={"gate": 60.0, "max_candidates": 4000},
        open_world=world,
    )
    return beliefs_at_rest(frames, configuration, known, backends, sigma)


def _exact(number: int, seen: Sequence[Detection], wrong: float) -> float:
    """Probability that an object was moved: all choices of which of its detections have wrong names."""
    region, quadrature, total = Configuration().open_world, ObjectQuadrature(), np.zeros(2)
    area = 0.5 * region.field_of_view_rad * (region.max_range_m**2 - region.min_range_m**2)
    for moved, sigma in enumerate((SIGMA_MAP, float(np.hypot(SIGMA_MAP, SIGMA)))):
        for right in product((True, False), repeat=len(seen)):
            held = [own for own, is_right in zip(seen, right, strict=True) if is_right]
            others = [own.range_m / area * wrong / (1.0 - wrong) for own in seen if own not in held]
            evidence = quadrature.moments(PLACES[number], sigma, held)[0]
            total[moved] += evidence * np.prod(others) * (SHARE if moved else 1.0 - SHARE)
    return float(total[1] / total.sum())


@pytest.mark.parametrize("wrong", [0.0, 0.005, 0.2])
def test_what_was_moved_is_that_of_all_choices_of_wrong_names_and_moved_objects(wrong: float) -> None:
    places = [PLACES[0] + [0.5, 0.2], PLACES[0] + [0.53, 0.15]], [PLACES[1] + [0.05, 0.02], PLACES[1] + [-0.04, 0.1]]
    frames = [_named(*both) for both in zip(*places, strict=True)]
    belief = _run(frames, wrong)[-1]
    expected = [_exact(n, [frame[n] for frame in frames], wrong) for n in range(2)]
    assert 0.2 < expected[0] < 0.9999
    np.testing.assert_allclose(belief.moved, expected, atol=0.01)


def test_six_detections_at_another_place_are_of_one_moved_object_and_one_is_as_likely_a_wrong_name() -> None:
    beliefs = _run([_named(FAR, PLACES[1])] * 6)
    assert beliefs[-1].moved[0] > 0.99 and beliefs[-1].moved[1] < SHARE
    assert beliefs[0].moved[0] == pytest.approx(_exact(0, _named(FAR), 0.005), abs=0.01) and beliefs[0].moved[0] < 0.98
    np.testing.assert_allclose(beliefs[-1].object_poses[0, :2], FAR, atol=0.1)
    np.testing.assert_allclose(beliefs[-1].existence, 1.0, atol=1e-9)


@pytest.mark.parametrize("wrong", [0.0, 0.005])
def test_what_stands_elsewhere_does_not_pull_the_robot(wrong: float) -> None:
    said, unsaid = (_run([_named(FAR, PLACES[1])] * 4, wrong, share, sigma=0.3)[-1] for share in (SHARE, 0.0))
    assert said.moved[0] > 0.95 and np.isnan(unsaid.moved).all()
    assert np.hypot(*said.poses[0, :2]) < 0.1
    if wrong == 0.0:
        assert np.hypot(*unsaid.poses[0, :2]) > 0.15


def test_no_history_has_an_object_at_two_places() -> None:
    for belief in _run([[*_named(PLACES[0]), *_named(FAR)]] * 2):
        assert set(belief.associations.ravel()) <= {-1, 0}
        assert np.exp(belief.log_weights)[(belief.associations == 0).all(axis=1)].sum() < 1e-6


@pytest.mark.parametrize("name", ["cup_moved", "8", "9"])
def test_a_name_that_the_map_lacks_is_of_a_new_object_and_of_nothing_that_was_moved(name: str) -> None:
    new = Detection.at(2.0, 0.0, track_id=name)
    belief = _run([[*_named(PLACES[0]), new]] * 2)[-1]
    assert len(belief.object_ids) == 3 and np.isnan(belief.moved[2]) and belief.moved[0] < SHARE
    np.testing.assert_allclose(belief.object_poses[2, :2], [2.0, 0.0], atol=0.1)


def test_without_a_map_nothing_was_moved() -> None:
    belief = _run([_named(*PLACES)] * 2, known=MapPrior())[-1]
    assert len(belief.object_ids) == 2 and np.isnan(belief.moved).all()


def test_backends_agree_on_what_was_moved_to_the_bit() -> None:
    frames = [_named(PLACES[0] + [0.4, 0.3], PLACES[1])] * 2
    one, three = (_run(frames, backends=backends) for backends in (1, 3))
    for own, other in zip(one, three, strict=True):
        np.testing.assert_array_equal(own.log_weights, other.log_weights)
        np.testing.assert_array_equal(own.moved, other.moved)


def test_single_steps_refuse_moved_objects_and_name_the_remedy() -> None:
    with pytest.raises(InputError, match=r"displaced_share .* given with open_world\.iterate_updates: true; set these"):
        _run([_named(*PLACES)], iterate_updates=False)

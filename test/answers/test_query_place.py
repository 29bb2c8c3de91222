"""What is at a place, and what should be there and is not."""

from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.studies.embeddings.known_map import map_of

from semantic_slam import InputError, MapPrior, ObjectPrior, query_place
from semantic_slam.cli.find_place import table

ORIGIN = (-0.5, -0.5, 0.5, 0.5)


def mapped(*x_m: float, existence: float = 1.0) -> MapPrior:
    """Objects 0, 1, ... at these places, known to the millimetre."""
    return MapPrior(
        tuple(
            ObjectPrior.planar(n, x, 0.0, sigma_m=1e-3, sigma_rad=0.1, existence=existence) for n, x in enumerate(x_m)
        )
    )


def test_an_object_is_here_as_probably_as_it_exists_and_its_place_lies_in_the_region():
    belief = replace(map_of(3), existence=np.array([0.8, 0.5, 1.0]))
    (first, *others) = query_place(belief, (-1.0, -1.0, 0.0, 1.0))
    assert (first.object_id, first.here) == (0, pytest.approx(0.4, abs=1e-3))
    assert all(own.here < 1e-9 and own.gone == 0.0 for own in others)
    assert [own.object_id for own in query_place(belief)] == [2, 0, 1]
    assert [own.object_id for own in query_place(belief, ORIGIN, 0.1)] == [0]


def test_an_object_of_two_places_is_in_a_region_as_one_gaussian_with_the_numbers_of_the_page():
    """It is at y = 1.2 or -1.2 m, with probability 0.5 each: mean 0 and standard deviation 1.2 m."""
    covariances = np.array([np.diag([1e-4, 1.2**2, 1e-4, 1e-4, 1e-4, 1e-4])])
    belief = replace(map_of(1), object_covariances=covariances)
    for y_min, y_max, told in ((0.9, 1.5, 0.12), (-1.5, -0.9, 0.12), (-0.5, 0.5, 0.32)):
        (found,) = query_place(belief, (-1.0, y_min, 1.0, y_max))
        assert found.here == pytest.approx(told, abs=0.005)


def test_what_stood_here_and_is_missing_is_gone_from_here_and_from_nowhere_else():
    belief = replace(map_of(2), existence=np.array([0.1, 1.0]), missing=np.array([0.9, 0.0]))
    (first,) = query_place(belief, ORIGIN, 0.05)
    assert (first.here, first.gone) == (pytest.approx(0.1), pytest.approx(0.9))
    assert query_place(belief, (10.0, 10.0, 11.0, 11.0), 0.05) == ()


def test_what_was_moved_is_gone_from_where_the_map_has_it():
    """Object 1 stands at x = 1 now, and stood at x = 0 when the map was made."""
    belief = replace(map_of(2), moved=np.array([0.0, 0.75]))
    before = mapped(0.0, 0.0)
    assert [(own.object_id, own.gone) for own in query_place(belief, ORIGIN, 0.1, before)] == [
        (0, 0.0),
        (1, pytest.approx(0.75)),
    ]
    there = query_place(belief, (0.5, -0.5, 1.5, 0.5), 0.1, before)
    assert [(own.object_id, own.here, own.gone) for own in there] == [(1, pytest.approx(1.0), pytest.approx(0.0))]


@pytest.mark.parametrize("moved", [0.0, 0.3, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("stood", [1.0, 0.5])
def test_what_may_have_been_moved_is_gone_with_the_sum_over_all_that_may_have_happened(
    moved: float, stood: float
) -> None:
    """Stood in the region or 9 m off; not moved, or moved 3 m off with 0.8 and to another place in the region."""
    to_outside, exists = 0.8, 0.9
    happened = [
        (0.0, (1.0 - moved) * stood),
        (9.0, (1.0 - moved) * (1.0 - stood)),
        (3.0, moved * to_outside),
        (0.2, moved * (1.0 - to_outside)),
    ]
    x_m, shares = np.array([[x, share] for x, share in happened if share > 0.0]).T
    belief = replace(
        map_of(1),
        existence=np.array([exists]),
        moved=np.array([moved]),
        place_objects=np.zeros(len(x_m), dtype=np.uint32),
        place_probabilities=shares,
        place_means=np.column_stack([x_m, np.zeros((len(x_m), 2))]),
        place_covariances=np.array([1e-6 * np.eye(3)] * len(x_m)),
    )
    at_edge = ORIGIN[2] if stood == 0.5 else 0.0  # half of the map's Gaussian lies in the region
    (found,) = query_place(belief, ORIGIN, 0.0, mapped(at_edge, existence=exists))
    assert found.here == pytest.approx(exists * ((1.0 - moved) * stood + moved * (1.0 - to_outside)))
    assert found.gone == pytest.approx(exists * moved * stood * to_outside)


def test_what_the_map_has_and_the_belief_has_given_up_should_be_here_and_is_not():
    doubted = replace(map_of(1), existence=np.array([0.2]))
    placed = query_place(doubted, None, 0.0, mapped(0.0, 5.0, existence=0.9))
    assert [(own.object_id, own.here, own.gone) for own in placed] == [
        (0, pytest.approx(0.2), pytest.approx(0.7)),
        (1, 0.0, pytest.approx(0.9)),
    ]
    assert [line.split()[:3] for line in table(doubted, placed)[1:]] == [
        ["0.2000", "0.7000", "0"],
        ["0.0000", "0.9000", "1"],
    ]


def test_a_region_that_is_none_is_refused():
    for region in ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 1.0)):
        with pytest.raises(InputError, match="region must be"):
            query_place(map_of(1), region)

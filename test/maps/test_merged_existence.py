"""Objects of merged maps exist as the difference of both maps has it, against enumerations of all correspondences."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.as_prior import saved_map_of_prior
from semantic_slam.maps.comparison import LEAST_UNSEEN, Comparison
from semantic_slam.maps.differences import difference
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.merging import merged
from semantic_slam.maps.saved_map import SavedMap, ViewedFrom

PLACES = np.array([[0.0, 0.0], [3.0, 0.5], [1.0, 2.5], [4.0, 3.0]])
LOOKS = 30


def room(rows: list[int], existence: list[float], *, first: int = 0, looks: int = LOOKS) -> SavedMap:
    """Some of the places, of which a robot at the origin saw each in 9 of 10 looks."""
    objects = [ObjectPrior.planar(first + n, *PLACES[n], 0.3 * n, sigma_m=0.05, sigma_rad=0.1) for n in rows]
    known = saved_map_of_prior(MapPrior(tuple(objects)))
    seen = replace(known.objects, existence=np.array(existence), sightings=np.full(len(rows), 0.9 * looks))
    viewed = ViewedFrom(path=np.zeros((looks, 3)), region=np.array([0.0, 2.0 * np.pi, 0.0, 20.0]))
    return with_id(replace(known, objects=seen, looks=viewed))


def matchings(count: int, size: int) -> Iterator[tuple[int, ...]]:
    for own in product(range(-1, size), repeat=count):
        taken = [j for j in own if j >= 0]
        if len(taken) == len(set(taken)):
            yield own


def weights_of(told: Comparison) -> dict[tuple[int, ...], float]:
    """Probabilities of all correspondences: the new object of each old one, or -1."""
    existence, pairs = told.ours.existence, told.best.pairs
    both = np.exp(pairs.log_same) + np.exp(pairs.log_displaced)
    absent = 1.0 - existence + existence * (0.05 + LEAST_UNSEEN)
    found = {
        own: float(np.prod([absent[i] if j < 0 else both[i, j] for i, j in enumerate(own)]))
        for own in matchings(len(told.ours), len(told.theirs))
    }
    return {own: weight / sum(found.values()) for own, weight in found.items()}


def unseen_alone(told: Comparison, row: int) -> float:
    """Probability that an old object without counterpart stands unseen, rather than left or never existed."""
    exists, unseen = told.ours.existence[row], told.unseen[row]
    stays = exists * 0.05 * unseen / (1.0 - unseen)
    return float(stays / (1.0 - exists + exists * 0.05 + stays))


@pytest.mark.parametrize("existence", [0.06, 0.3, 0.8, 0.95, 0.9999])
def test_what_the_other_robot_looked_for_in_vain_exists_as_the_difference_says(existence: float) -> None:
    """The surer the first map was, the likelier that it is there unseen; a false alarm is refuted all the more."""
    one, other = room([0, 1, 2, 3], [1.0, 1.0, 1.0, existence]), room([0, 1, 2], [1.0] * 3, first=20)
    told = Comparison.of(one, other, same_frame=True)
    exact = sum(weight * (1.0 if own[3] >= 0 else unseen_alone(told, 3)) for own, weight in weights_of(told).items())
    shares = difference(told).old[3].probabilities
    assert merged(one, other, "", same_frame=True).objects.existence[3] == pytest.approx(exact, abs=1e-6)
    assert shares["same"] + shares["displaced"] + shares["unseen"] == pytest.approx(exact, abs=1e-6)
    assert exact < 0.03


@pytest.mark.parametrize(("existence", "off"), [(0.06, 0.0), (0.1, 0.0), (0.3, 0.1), (0.5, 0.3), (0.9, 0.6)])
def test_what_both_maps_have_exists_as_the_enumeration_says(existence: float, off: float) -> None:
    """Either as one object, or as one that stands unseen beside one that is new."""
    one, other = room([0, 1, 3], [1.0, 1.0, existence]), room([0, 1, 3], [1.0, 1.0, existence], first=20)
    apart = other.objects.poses.copy()
    apart[2, 0] += off
    states = other.hypotheses.states.copy()
    states[0, 2, 0] += off
    hypotheses = replace(other.hypotheses, states=states)
    other = with_id(replace(other, objects=replace(other.objects, poses=apart), hypotheses=hypotheses))
    told, exact = Comparison.of(one, other, same_frame=True), 0.0
    for own, weight in weights_of(told).items():
        stands = 1.0 if own[2] >= 0 else unseen_alone(told, 2)
        exists = 1.0 if 2 in own else existence
        exact += weight * (1.0 - (1.0 - stands) * (1.0 - exists))
    both = merged(one, other, "", same_frame=True).objects
    assert len(both) == 3
    assert both.existence[2] == pytest.approx(exact, abs=1e-4)
    assert both.existence[2] >= 1.0 - (1.0 - existence) ** 2 - 1e-4

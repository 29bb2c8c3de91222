"""Every association strategy keeps the contract, and what enumeration promises beyond it."""

import itertools

import numpy as np
import pytest

from semantic_slam.contracts.association_strategy import OBJECTS, START_SIGMAS, AssociationStrategyContract
from semantic_slam.geometry import se2
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool

pytestmark = pytest.mark.slow  # many short runs of the engine

NO_MERGING = {"open_world": {"merge_position_m": 0.0, "field_of_view_rad": 1.5, "max_range_m": 3.2}}


class TestEnumerated(AssociationStrategyContract):
    association = "enumerated"

    def test_weights_are_those_of_brute_force(self) -> None:
        """P(beta | z) of the first keyframe is E[prod p(z | x, o_beta)] over draws of the prior, each beta alike."""
        (first, *_), run = self.keyframes(), self.run()
        belief = Engine.of_run(run, InProcessPool(1)).process(first)
        random, draws, seen = np.random.default_rng(2), 200_000, first.measurements
        x = se2.exp(random.normal(size=(draws, 3)) * START_SIGMAS)
        density = np.array([_densities(x, o + random.normal(size=(draws, 2)) * 0.05, seen) for o in OBJECTS])
        assert len(seen) == 2
        found = np.zeros((2, len(OBJECTS)))
        for one, other in itertools.permutations(range(len(OBJECTS)), 2):
            evidence = (density[one, 0] * density[other, 1]).mean()
            found[0, one] += evidence
            found[1, other] += evidence
        expected = found / found.sum(axis=1, keepdims=True)
        assert (expected > 0.05).sum() >= 4  # which pair it is is open
        np.testing.assert_allclose(belief.association_probabilities[:, :-1], expected, atol=0.02)


class TestGiven(AssociationStrategyContract):
    association = "given"
    rebuilt_within = 1e-9  # a broad prior of 1000 m leaves iSAM2 the last bits: they depend on what was asked between

    def test_detections_are_of_the_objects_that_they_name(self) -> None:
        belief, last = self.beliefs(InProcessPool(1))[-1], self.keyframes()[-1]
        (only,) = belief.hypotheses
        named = {known.object_id: known.name for known in belief.objects}
        assert tuple(named[n] for n in only.associations) == last.measurements.track_ids


class TestGivenInSingleSteps(TestGiven):
    others = {"open_world": {"iterate_updates": False}}  # noqa: RUF012


class TestGivenWithErrorsThatRepeat(TestGiven):
    others = {  # noqa: RUF012
        "open_world": {"iterate_updates": False, "learn_region": True},
        "odometry": {"estimate_bias": True},
        "detection_errors": {"correlated_share": 0.9},
    }
    rebuilt_within = 0.0


class TestOpen(AssociationStrategyContract):
    association = "open"
    others = NO_MERGING


class TestEnumeratedPoints(AssociationStrategyContract):
    association = "enumerated"
    others = {"observation": "points"}  # noqa: RUF012


class TestGivenPoints(AssociationStrategyContract):
    association = "given"
    others = {"observation": "points"}  # noqa: RUF012
    rebuilt_within = 1e-8


class TestOpenWithMerging(AssociationStrategyContract):
    association = "open"


class TestNearestNeighbour(AssociationStrategyContract):
    association = "nearest_neighbour"
    others = NO_MERGING

    def test_nearest_neighbour_association_keeps_one_hypothesis(self) -> None:
        pytest.importorskip("semantic_slam_lab")
        assert {len(belief.hypotheses) for belief in self.beliefs(InProcessPool(1))} == {1}


def _densities(x: np.ndarray, o: np.ndarray, seen) -> np.ndarray:
    """(D, B) densities of the detections at B robots and places of an object, up to a constant."""
    body = se2.between(x, np.column_stack([o, np.zeros(len(o))]))
    ranges, bearings = np.hypot(body[:, 0], body[:, 1]), np.arctan2(body[:, 1], body[:, 0])
    off = ((seen.ranges_m[:, None] - ranges) / 0.1) ** 2 + ((seen.bearings_rad[:, None] - bearings) / 0.03) ** 2
    return np.exp(-0.5 * off)

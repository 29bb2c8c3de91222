"""Contract test of association strategies: the test of a new strategy is a subclass that sets ``association``."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from semantic_slam.configuration import Configuration
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import make_run_configuration, start_of_run
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates, RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.registry import ASSOCIATIONS

OBJECTS: Array = np.array([[2.0, 1.0], [2.0, -1.0], [4.0, 1.2], [4.2, -0.8], [6.0, 0.9], [6.1, -1.0]])
"""Positions [m] of look-alike object pairs along the path: a robot off by one pair sees nearly the same scene."""
STEP = np.array([0.5, 0.0, 0.03])
SIGHT_M = 3.0
START_SIGMAS = np.array([2.0, 0.2, 0.1])


class WitnessPool(InProcessPool):
    """In-process backend pool that records the candidates of every keyframe."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.seen: list[list[Candidates]] = []

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """First message round: expand the hypotheses; the candidates are appended to ``seen``."""
        self.seen.append(super().expand(keyframe))
        return self.seen[-1]


class AssociationStrategyContract:
    """Subclass and set ``association``; ``others`` holds further parameters that the strategy needs."""

    association: str
    others: dict[str, Any] = {}  # noqa: RUF012  # a subclass replaces it whole
    num_keyframes = 8
    rebuilt_within = 0.0  # pose tolerance [m, rad] after a component was rebuilt; 0: bit-identical

    def run(self) -> RunConfiguration:
        """Run configuration with an uncertain initial pose, and with a prior map where the strategy needs one."""
        configuration = Configuration.of(
            **{"association": self.association, "semantic_model": {"kind": "none"}, **self.others}
        )
        known = [ObjectPrior.planar(n, x, y, sigma_m=0.05, sigma_rad=0.1) for n, (x, y) in enumerate(OBJECTS)]
        prior = MapPrior(tuple(known)) if ASSOCIATIONS.load(self.association).needs_map else None
        pose, covariance = start_of_run(configuration, (0.0, 0.0, 0.0), np.diag(START_SIGMAS**2))
        return make_run_configuration(configuration, prior, pose, covariance, stamp_ns=0)

    def keyframes(self) -> list[Keyframe]:
        """Keyframes of a drive past the objects; every second one has detections, with their object as ``track_id``."""
        random = np.random.default_rng(1)
        x, found = np.array([0.2, 0.1, 0.0]), []
        for k in range(self.num_keyframes):
            if k:
                x = se2.compose(se2.compose(x, STEP), se2.exp(random.normal(size=3) * [0.02, 0.02, 0.01]))
            found.append(Keyframe.planar(k, motion=STEP if k else np.zeros(3), detections=_seen(x, random)))
        return found

    def beliefs(self, pool: InProcessPool) -> list[HybridBelief]:
        """Hybrid belief after every keyframe."""
        engine = Engine.of_run(self.run(), pool)
        return [engine.process(keyframe) for keyframe in self.keyframes()]

    @pytest.fixture(scope="class")
    @classmethod
    def witness(cls) -> tuple[WitnessPool, list[HybridBelief]]:
        """Reference run with one backend: its pool and its beliefs."""
        pool = WitnessPool(1)
        return pool, cls().beliefs(pool)

    def test_candidates_continue_hypotheses_that_live(self, witness: tuple[WitnessPool, list[HybridBelief]]) -> None:
        pool, beliefs = witness
        for (candidates,), before in zip(pool.seen[1:], beliefs, strict=False):
            assert set(candidates.parent_ids.tolist()) <= set(before.hypothesis_ids.tolist())
            assert len(set(candidates.ids.tolist())) == len(candidates.ids) > 0
            assert np.isfinite(candidates.log_weights).all()

    def test_no_object_takes_two_detections_of_a_keyframe(
        self, witness: tuple[WitnessPool, list[HybridBelief]]
    ) -> None:
        for (candidates,) in witness[0].seen:
            for row in candidates.associations.tolist():
                taken = [number for number in row if number >= 0]
                assert len(set(taken)) == len(taken)

    def test_candidates_differ(self, witness: tuple[WitnessPool, list[HybridBelief]]) -> None:
        for (candidates,) in witness[0].seen:
            rows = zip(candidates.parent_ids, candidates.associations, candidates.class_assignments, strict=True)
            told = [(int(parent), *map(int, own), *map(int, classes)) for parent, own, classes in rows]
            modes = candidates.modes.tolist()
            assert len(set(zip(told, modes, strict=True))) == len(told)

    def test_weights_are_a_distribution(self, witness: tuple[WitnessPool, list[HybridBelief]]) -> None:
        for belief in witness[1]:
            assert np.exp(belief.log_weights).sum() == pytest.approx(1.0, abs=1e-12)
            assert 0.0 <= belief.discarded_mass < 1.0
            np.testing.assert_allclose(belief.association_probabilities.sum(axis=1), 1.0, atol=1e-12)

    @pytest.mark.parametrize("number", [2, 3])
    def test_the_number_of_backends_changes_nothing(
        self, witness: tuple[WitnessPool, list[HybridBelief]], number: int
    ) -> None:
        same(self.beliefs(InProcessPool(number)), witness[1])

    def test_a_component_made_again_along_its_lineage_is_the_same(
        self, witness: tuple[WitnessPool, list[HybridBelief]]
    ) -> None:
        forgetful = ForgetfulPool(2, dies_at=self.num_keyframes - 2)
        same(self.beliefs(forgetful), witness[1], self.rebuilt_within)


def same(some: Sequence[HybridBelief], others: Sequence[HybridBelief], tolerance: float = 0.0) -> None:
    """Assert that beliefs are equal: identifiers exactly, estimates within ``tolerance``."""
    for one, other in zip(some, others, strict=True):
        for name in ("hypothesis_ids", "parent_ids", "associations", "object_ids"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
        for name in ("log_weights", "poses", "pose_covariances", "object_poses", "object_covariances", "existence"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0.0, atol=tolerance, err_msg=name)
        told, again = [(own.log_evidence, own.innovation_nees, own.unexplained) for own in (one, other)]
        np.testing.assert_allclose(told, again, rtol=0.0 if tolerance == 0.0 else 1e-3, atol=tolerance)


def _seen(x: Array, random: np.random.Generator) -> list[Detection]:
    """Detections of the nearest two visible objects, for a robot pose x, y, yaw."""
    body = se2.between(np.broadcast_to(x, (len(OBJECTS), 3)), np.column_stack([OBJECTS, np.zeros(len(OBJECTS))]))
    distance, bearing = np.hypot(body[:, 0], body[:, 1]), np.arctan2(body[:, 1], body[:, 0])
    near = [n for n in np.argsort(distance).tolist() if distance[n] < SIGHT_M and abs(bearing[n]) < 0.7][:2]
    noise = random.normal(size=(len(near), 2)) * [0.1, 0.03]
    return [
        Detection(range_m=float(distance[n] + e[0]), bearing_rad=float(bearing[n] + e[1]), track_id=f"object_{n}")
        for n, e in zip(near, noise, strict=True)
    ]

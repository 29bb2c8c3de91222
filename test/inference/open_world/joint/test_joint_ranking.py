"""Joint assignments of many detections against the enumeration of all of them, in linear-Gaussian frames."""

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product

import numpy as np
import pytest
from worlds.exact.linear_gaussian import LinearDetection, LinearModel

from semantic_slam.inference.association.gating import RankedAssignments, best_assignments, pair_densities
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.open_world.joint.costs import JointCosts
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.open_world.joint.ranking import JointRanking
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces

SIGMA, GATE = 0.1, 6.0
SPACES = Spaces.same(PlanarPositions())
LOG_NEW, LOG_RATIO = -3.0, 0.5


@dataclass(frozen=True)
class Frame:
    """Detections of twins, from a robot whose place is uncertain."""

    mean: np.ndarray  # (1 + M, 2) robot and objects
    covariance: np.ndarray
    offsets: np.ndarray  # (D, 2) measured

    @cached_property
    def linear(self) -> LinearisedEvidence:
        return LinearisedEvidence(SPACES, self.mean, self.covariance, self.pairs, [], np.zeros(len(self.offsets)))

    @cached_property
    def pairs(self):
        model = LinearModel(SIGMA**2 * np.eye(2), np.eye(2), np.zeros((0, 2)), np.zeros((0, 2, 2)), 0)
        detections = [LinearDetection(offset, np.zeros(2)) for offset in self.offsets]
        predicted = PredictedBelief(SPACES.layout, self.mean[None], self.covariance[None])
        return pair_densities(SPACES, model, detections, predicted)

    @property
    def num_objects(self) -> int:
        return len(self.mean) - 1

    @property
    def log_new(self) -> np.ndarray:
        return np.full(len(self.offsets), LOG_NEW)

    @cached_property
    def everything(self) -> tuple[np.ndarray, np.ndarray]:
        """All joint assignments that are admitted, (K, D), and their joint weights."""
        admitted = self.pairs.distance < GATE
        options = [[*np.flatnonzero(row), self.num_objects + number] for number, row in enumerate(admitted)]
        rows = np.array([own for own in product(*options) if len(set(own)) == len(own)])
        return rows, self.weighed(rows)

    def weighed(self, rows: np.ndarray) -> np.ndarray:
        """(K,) as the engine weighs them."""
        known = rows < self.num_objects
        assignments = Assignments(parents=np.zeros(len(rows), dtype=int), objects=rows)
        found = self.linear.evaluate(assignments, np.where(known, rows, -1)).column("log_evidence")
        return found + np.where(known, LOG_RATIO, LOG_NEW).sum(axis=1)

    @property
    def log_pairs(self) -> np.ndarray:
        return self.pairs.log_density + LOG_RATIO

    @property
    def costs(self) -> JointCosts:
        ratio, alone = np.full(self.num_objects, LOG_RATIO), self.log_new[:, None]
        return JointCosts.of(self.linear, self.pairs.distance < GATE, ratio, alone)

    def by_pairs(self, limit: int) -> RankedAssignments:
        return self._ranked(limit)(self.log_pairs)

    def jointly(self, limit: int, gate: float = np.inf) -> RankedAssignments:
        ranking = JointRanking(
            costs=self.costs,
            log_pairs=self.log_pairs,
            admitted=self.pairs.distance < GATE,
            ranked=self._ranked(limit),
            reach=7.0,
        )
        return ranking.best(limit, gate)

    def _ranked(self, limit: int):
        admitted = self.pairs.distance < GATE
        return partial(best_assignments, admitted=admitted, log_new=self.log_new, limit=limit, gate=np.inf)

    def marginals(self, rows: np.ndarray, log_weights: np.ndarray) -> np.ndarray:
        """(D, M + 1)"""
        weights = np.exp(log_weights - np.logaddexp.reduce(log_weights))
        found = np.zeros((len(self.offsets), self.num_objects + 1))
        for number, own in enumerate(rows.T):
            np.add.at(found[number], np.minimum(own, self.num_objects), weights)
        return found


def twins(random: np.random.Generator, groups: int, robot_sigma: float) -> Frame:
    """``groups`` far from each other of two objects 0.4 m apart, each of them detected as likely as not."""
    centres = np.stack([10.0 * np.arange(groups), np.zeros(groups)], axis=1)
    objects = (centres[:, None] + np.array([[-0.2, 0.0], [0.2, 0.0]])).reshape(-1, 2)
    spread = np.kron(np.diag([robot_sigma**2, *np.full(2 * groups, 0.1**2)]), np.eye(2))
    mean = np.concatenate([np.zeros((1, 2)), objects])
    truth = random.multivariate_normal(mean.ravel(), spread).reshape(-1, 2)
    seen = np.flatnonzero(random.uniform(size=2 * groups) < 0.5)
    offsets = truth[1 + seen] - truth[0] + SIGMA * random.normal(size=(len(seen), 2))
    return Frame(mean, spread, offsets)


def some_twins(robot_sigma: float, count: int) -> list[Frame]:
    """Of those with more joint assignments than are followed."""
    random = np.random.default_rng(5)
    drawn = (twins(random, 4, robot_sigma) for _ in range(10 * count))
    return [frame for frame in drawn if len(frame.offsets) and len(frame.everything[0]) > LIMIT][:count]


LIMIT = 30


def test_joint_weights_are_those_of_the_engine() -> None:
    frame = twins(np.random.default_rng(0), 3, 0.3)
    rows, log_weights = frame.everything
    np.testing.assert_allclose(frame.costs.log_scores(rows), log_weights, atol=1e-9)


def test_what_one_detection_changes_is_exact_given_the_others() -> None:
    """p(z, all others) / p(all others), whichever object the detection is of."""
    frame = twins(np.random.default_rng(1), 4, 0.3)
    costs, (rows, log_weights) = frame.costs, frame.everything
    top = rows[np.argmax(log_weights)]
    table = costs.given_others(top)
    free = [n for n in range(frame.num_objects) if n not in top]
    tried = 0
    for number, now in enumerate(top):
        for other in free:
            changed = top.copy()
            changed[number] = other
            if not np.isfinite(table[number, other]):
                continue
            tried += 1
            own = table[number, now] if now < frame.num_objects else LOG_NEW
            gain = costs.log_scores(changed[None])[0] - log_weights.max()
            assert table[number, other] - own == pytest.approx(gain, abs=1e-9)
    assert tried


def test_a_pair_by_itself_tells_the_pose() -> None:
    frame = twins(np.random.default_rng(2), 3, 0.3)
    costs = frame.costs
    for pair, table in enumerate(costs.given_each(np.arange(len(costs.rows)))):
        detection, column = costs.rows[pair], costs.columns[pair]
        nobody = frame.num_objects + np.arange(len(frame.offsets))
        alone = nobody.copy()
        alone[detection] = column
        for other, known in zip(*np.nonzero(np.isfinite(table)), strict=True):
            if other == detection:
                continue
            both = alone.copy()
            both[other] = known
            gain = np.diff(costs.log_scores(np.array([alone, both])))[0]
            assert table[other, known] - LOG_NEW == pytest.approx(gain, abs=1e-9)


def test_clusters_that_are_independent_weigh_together_what_all_their_assignments_do() -> None:
    """The robot's place is known: eight of some thousand joint assignments, and the mass of the others, to 1e-9."""
    for frame in some_twins(robot_sigma=0.0, count=3):
        rows, log_weights = frame.everything
        found = frame.jointly(8)
        assert len(found.columns) == 8 < len(rows)
        np.testing.assert_allclose(found.log_scores, np.sort(log_weights)[::-1][:8], atol=1e-9)
        everything = np.logaddexp.reduce([*found.log_scores, found.log_scores[0] + found.log_left_out])
        assert everything == pytest.approx(np.logaddexp.reduce(log_weights), abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("robot_sigma", [0.05, 0.2, 1.0])
def test_of_coupled_clusters_little_is_missed(robot_sigma: float) -> None:
    """Total variation of what each detection is of, against all joint assignments: median and worst of 30 frames."""
    jointly, by_pairs = [], []
    for frame in some_twins(robot_sigma, 30):
        exact, found, other = frame.marginals(*frame.everything), frame.jointly(LIMIT), frame.by_pairs(LIMIT)
        jointly.append(_variation(frame.marginals(found.columns, found.log_scores), exact))
        by_pairs.append(_variation(frame.marginals(other.columns, frame.weighed(other.columns)), exact))
    assert np.median(jointly) <= 0.01 and max(jointly) <= 0.05
    if robot_sigma > 0.1:  # as wide as twins are apart: pairs by themselves take the best for impossible
        assert max(by_pairs) > 0.5


def _variation(found: np.ndarray, exact: np.ndarray) -> float:
    """Of the detection for which it is largest."""
    return float(0.5 * np.abs(found - exact).sum(axis=1).max())


def test_a_robot_that_may_stand_elsewhere_has_all_detections_differ_at_once() -> None:
    """A row of eight objects 1 m apart, the robot known to 1 m: five detections are five in a row, whichever."""
    objects = np.stack([np.arange(8.0), np.zeros(8)], axis=1)
    spread = np.kron(np.diag([1.0, *np.full(8, 0.05**2)]), np.eye(2))
    frame = Frame(np.concatenate([np.zeros((1, 2)), objects]), spread, objects[2:7] + 0.02)
    found = frame.jointly(LIMIT)
    in_a_row = [[first + number for number in range(5)] for first in (1, 2, 3)]
    for row in in_a_row:
        assert row in found.columns.tolist()
    np.testing.assert_allclose(found.log_scores, frame.weighed(found.columns), atol=1e-9)
    assert (np.diff(found.log_scores) <= 0.0).all()


def test_what_is_weighed_elsewhere_ranks_along() -> None:
    """Two of the columns are ways to be of the first object without telling of the robot: one detection at most."""
    frame = twins(np.random.default_rng(6), 2, 0.3)
    count, num = len(frame.offsets), frame.num_objects
    beside = np.where(np.arange(count)[:, None] < 2, 1.0, -np.inf) + np.zeros((count, 1))
    log_pairs = np.concatenate([frame.log_pairs, beside], axis=1)
    admitted = np.concatenate([frame.pairs.distance < GATE, np.isfinite(beside)], axis=1)
    alone = np.concatenate([beside, frame.log_new[:, None]], axis=1)
    costs = JointCosts.of(frame.linear, frame.pairs.distance < GATE, np.full(num, LOG_RATIO), alone)
    names = np.append(np.arange(num), 0)
    ranked = partial(best_assignments, admitted=admitted, log_new=frame.log_new, limit=500, gate=np.inf, objects=names)
    ranking = JointRanking(costs=costs, log_pairs=log_pairs, admitted=admitted, ranked=ranked, reach=7.0)
    found = ranking.best(500, np.inf)
    options = [[*np.flatnonzero(row), num + 1 + number] for number, row in enumerate(admitted)]
    of_objects = [tuple(0 if own == num else own for own in row) for row in product(*options)]
    rows = [row for row, own in zip(product(*options), of_objects, strict=True) if len(set(own)) == count]
    assert {tuple(row) for row in found.columns.tolist()} == {tuple(map(int, row)) for row in rows}
    every = np.array(rows)
    still = frame.weighed(np.where(every < num, every, num + np.arange(count)))
    expected = still + np.where(every == num, 1.0 - LOG_NEW, 0.0).sum(axis=1)
    np.testing.assert_allclose(found.log_scores, np.sort(expected)[::-1], atol=1e-9)

"""Evidence averaged over resampled keyframes: steady evidence settles where the robot is, swings do not."""

import numpy as np
import pytest
from scipy.stats import norm
from worlds.drives.open_room import make_room
from worlds.same_beliefs import assert_same

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.bagging import Bagging
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.revision.replay import Replay

PLACE_M = 0.01
SETS = Bagging(seed=3, num_replicates=4000)


def share(gains: np.ndarray, bagging: Bagging = SETS) -> float:
    """P of a history that gains so much [nats] in each keyframe on another one, in which the robot is elsewhere."""
    replicates = bagging.begun(0.0)
    for keyframe, gain in enumerate(gains.tolist()):
        replicates = bagging.grown(replicates, keyframe, gain)
    plain = np.array([0.0, -np.logaddexp(0.0, gains.sum())])
    plain[0] = plain[1] + gains.sum()
    both = np.stack([replicates, bagging.begun(0.0)])
    return float(np.exp(bagging.log_weights(plain, both, np.array([0, 1]))[0]))


def test_what_rises_and_falls_settles_no_more_than_its_sum_beside_its_size() -> None:
    """The share of the resampled sums that are positive: that of a Gaussian, where they are far from 0."""
    gains = np.random.default_rng(0).normal(0.3, 10.0, 150)
    expected = norm.cdf(gains.sum() / np.sqrt((gains**2).sum()))
    assert share(gains) == pytest.approx(expected, abs=0.03)
    assert 0.05 < expected < 0.95


def test_steady_evidence_settles_where_the_robot_is() -> None:
    assert share(np.full(40, 1.0)) > 0.999
    assert share(np.full(40, -1.0)) < 0.001


def test_evidence_of_a_single_keyframe_settles_nothing() -> None:
    """As often as a resampled set lacks it, the question is open."""
    assert share(np.array([0.0, 50.0])) == pytest.approx(1.0 - 0.5 * np.exp(-1.0), abs=0.02)


def test_histories_of_one_place_weigh_as_before_beside_each_other() -> None:
    bagging = Bagging(seed=0, num_replicates=50)
    log_weights = np.log([0.6, 0.3, 0.1])
    replicates = np.array([bagging.grown(bagging.begun(0.0), k, gain) for k, gain in enumerate((2.0, 1.0, 3.0))])
    found = bagging.log_weights(log_weights, replicates, np.array([0, 0, 1]))
    assert found[0] - found[1] == pytest.approx(np.log(2.0), abs=1e-12)
    assert np.exp(found).sum() == pytest.approx(1.0, abs=1e-12)
    assert bagging.log_weights(log_weights, replicates, np.zeros(3, dtype=int)) is log_weights


@pytest.fixture(scope="module")
def driven() -> tuple[Engine, HybridBelief]:
    """Several hypotheses, with replicates, and the newest belief; the same of two backends."""
    room = make_room(
        12,
        4,
        clutter=0.6,
        weights={"bagged_sets": 20},
        pruning={"place_m": PLACE_M},
        open_world={"merge_position_m": 0.0, "iterate_updates": False},
    )
    one, two = (Engine.of_run(room.run, InProcessPool(number)) for number in (1, 2))
    for keyframe in room.keyframes:
        belief = one.process(keyframe)
        assert_same(two.process(keyframe), belief)
        one.steps.append(one.problem.reader.step(keyframe))
    return one, belief


@pytest.mark.long
def test_a_replayed_history_has_the_replicates_that_it_had_when_it_was_followed(
    driven: tuple[Engine, HybridBelief],
) -> None:
    engine, _ = driven
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps)
    live = list(engine.live.values())[:3]
    assert len(live) == 3
    for own in live:
        found = replay.followed(own.lineage)
        assert found is not None
        np.testing.assert_allclose(found.replicates, own.replicates, atol=1e-9)


def test_what_is_believed_is_averaged_and_what_is_followed_is_not(driven: tuple[Engine, HybridBelief]) -> None:
    engine, belief = driven
    weights = dict(zip(belief.hypothesis_ids.tolist(), np.exp(belief.log_weights).tolist(), strict=True))
    positions = dict(zip(belief.hypothesis_ids.tolist(), belief.poses[:, :3], strict=True))
    first = next(iter(engine.live))
    beside = [n for n in engine.live if np.linalg.norm(positions[n] - positions[first]) <= PLACE_M]
    assert 0 < len(beside) < len(engine.live)
    sets = np.exp([own.replicates for own in engine.live.values()])
    sets /= sets.sum(axis=0)
    rows = [row for row, n in enumerate(engine.live) if n in beside]
    assert sum(weights[n] for n in beside) == pytest.approx(sets[rows].sum(axis=0).mean(), abs=1e-9)
    exact = sum(np.exp(engine.live[n].log_weight) for n in beside)
    assert abs(exact - sum(weights[n] for n in beside)) > 1e-3
    assert (np.diff(belief.log_weights) <= 0.0).all()
    assert sum(weights.values()) == pytest.approx(1.0, abs=1e-9)

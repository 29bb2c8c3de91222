"""Alternatives to what is followed: shares are sums of weights, and beliefs tell them by those of hypotheses."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.evaluation.history import histories
from semantic_slam.evaluation.pairs import pair_calibration
from semantic_slam.inference.alternatives.differences import differences
from semantic_slam.inference.alternatives.shares import Shares
from semantic_slam.inference.alternatives.telling import balanced
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.shipped import configuration_file


def step(*association: int) -> LineageStep:
    return LineageStep(association, (-1,) * len(association))


def test_histories_differ_where_they_have_other_objects_since_they_parted() -> None:
    shared = step(0, 1)
    told, other = (shared, step(0), step(1, 2)), (shared, step(3), step(1, 0))
    assert differences(told, other) == ((1, 0, 3), (2, 1, 0))
    assert differences(told, told) == ()


def test_shares_are_those_of_the_weights_of_all_that_was_given_up() -> None:
    """Five histories of two questions, in whatever order they are given up: 0.5 of all have the first one otherwise."""
    first, second = ((3, 0, 7),), ((5, 1, 8),)
    shares, total = Shares(values=np.zeros((0, 2))), np.array([0.3, 0.1])
    for weight, changes in ((0.35, first), (0.1, second), (0.15, first)):
        total[0] += weight
        shares.give_up(weight / total[0], changes, np.zeros(0), 0)
    np.testing.assert_allclose(shares.values[:, 0], [0.5 / 0.9, 0.1 / 0.9])
    np.testing.assert_allclose(shares.values[:, 1], 0.0)


def test_what_goes_up_brings_its_own_alternatives() -> None:
    """A history that was to 0.4 otherwise, and weighs a third of both."""
    before = Shares([((3, 0, 7),)], np.array([[0.1, 0.4]]))
    shares = before.of_children(np.array([0]))
    shares.give_up(1.0 / 3.0, ((4, 0, 2),), before.values[:, 1], 0)
    np.testing.assert_allclose(shares.values[:, 0], [(2.0 * 0.1 + 0.4) / 3.0, 1.0 / 3.0])


def test_as_much_weight_tells_an_alternative_as_its_share_and_the_heaviest_none() -> None:
    random = np.random.default_rng(0)
    weights = np.sort(random.dirichlet(np.ones(20)))[::-1]
    values = np.repeat(random.uniform(0.0, 0.5, size=(50, 1)), 20, axis=1)
    shares = Shares([((k, 0, 1),) for k in range(50)], values)
    told = balanced(np.zeros((50, 20), dtype=bool), shares, weights)
    assert not told[:, 0].any()
    np.testing.assert_allclose(told @ weights, values[:, 0], atol=0.5 * weights[1])


def test_what_was_told_stays_where_it_weighs_enough() -> None:
    shares = Shares([((3, 0, 1),)], np.full((1, 10), 0.3))
    told = np.zeros((1, 10), dtype=bool)
    told[0, [2, 5, 7]] = True
    np.testing.assert_array_equal(balanced(told, shares, np.full(10, 0.1)), told)


def test_independent_alternatives_are_told_together_as_often_as_chance_has_it() -> None:
    shares = Shares([((k, 0, 1),) for k in range(200)], np.full((200, 41), 0.5))
    weights = np.full(41, 1.0 / 41.0)
    told = balanced(np.zeros((200, 41), dtype=bool), shares, weights)
    together = (told @ (told * weights).T)[np.triu_indices(200, 1)]
    assert together.mean() == pytest.approx(0.25, abs=0.02)
    assert together.std() < 0.12


def base(most: int) -> Configuration:
    found = load_configuration(configuration_file("uncalibrated"))
    single = replace(found.odometry, noise_factors=(1.0,), estimate_bias=False)
    return replace(
        found,
        keyframes=replace(found.keyframes, policy="every_detection"),
        odometry=single,
        perception=replace(found.perception, noise_factors=(1.0,)),
        pruning=replace(found.pruning, max_hypotheses=most),
    )


def drive(seed: int, count: int) -> tuple[list[Keyframe], list[int]]:
    """A robot that creeps past four pairs of twins, and sees one of a pair now and then; which one, of each detection.

    Detections err as the configuration has it, but each by itself.
    """
    random = np.random.default_rng(seed)
    places = np.array([[2.0 + x, side * 1.2] for x in range(4) for side in (-1.0, 1.0)])
    twins = np.stack([places, places + np.array([0.3, 0.0])], axis=1)
    keyframes, labels = [], list[int]()
    for index in range(count):
        pose = 0.12 * index
        seen = [
            (2 * pair + int(random.integers(2)))
            for pair in np.flatnonzero(random.random(len(twins)) < 0.5)
            if places[pair, 0] > pose + 0.5
        ]
        relative = twins.reshape(-1, 2)[seen] - [pose, 0.0]
        ranges, bearings = np.hypot(*relative.T), np.arctan2(relative[:, 1], relative[:, 0])
        ranges += np.hypot(0.1, 0.03 * ranges) * random.normal(size=len(seen))
        bearings += 0.03 * random.normal(size=len(seen))
        detections = [Detection(range_m=float(r), bearing_rad=float(b)) for r, b in zip(ranges, bearings, strict=True)]
        motion = np.array([0.12 if index else 0.0, 0.0, 0.0])
        sigmas = (0.02, 0.02, 0.02)
        keyframes.append(Keyframe.planar(index, motion=motion, detections=detections, motion_sigmas=sigmas))
        labels += seen
    return keyframes, labels


def run(keyframes: list[Keyframe]) -> tuple[Engine, list[HybridBelief]]:
    engine = Engine(base(8))
    return engine, [engine.process(keyframe) for keyframe in keyframes]


@pytest.mark.long
def test_the_likeliest_history_is_told_as_it_is_followed() -> None:
    engine, beliefs = run(drive(1, 10)[0])
    followed = next(iter(engine.live.values())).lineage
    told = histories(beliefs)
    assert [tuple(rows[0].tolist()) for rows in told] == [own.association for own in followed]
    assert any(len(belief.revised_ids) for belief in beliefs)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
def test_old_questions_stay_as_open_as_they_were(seed: int) -> None:
    """Against which twin each detection is of: what is told is better calibrated than what is followed."""
    keyframes, labels = drive(seed, 20)
    engine, beliefs = run(keyframes)
    weights = np.exp(beliefs[-1].log_weights)
    followed = [[n for own in live.lineage for n in own.association] for live in engine.live.values()]
    told = pair_calibration(weights, np.concatenate(histories(beliefs), axis=1), labels)
    assert told.ece_of_stated < pair_calibration(weights, np.array(followed), labels).ece_of_stated

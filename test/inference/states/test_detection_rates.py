"""What a sensor detects, by range, and how much there is: a hypothesis sums over settings, exactly."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from worlds.drives.open_room import make_room
from worlds.same_beliefs import assert_same

from semantic_slam import Configuration, Detection, Engine, InputError, Keyframe, MapPrior
from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.world.map_prior import ObjectPrior

PROBABILITIES, HALF_RANGES, PERSISTENCES = (0.3, 0.8), (2.5, 4.0), (0.6, 0.95)
RANGES, EXISTENCE = (1.0, 3.0), (0.7, 0.9)
GRID: dict[str, Any] = {
    "detection_probabilities": list(PROBABILITIES),
    "detection_half_ranges_m": list(HALF_RANGES),
    "birth_densities": [0.02, 0.3],
    "clutters_per_frame": [0.03, 0.6],
    "iterate_updates": False,
    "miss_persistences": list(PERSISTENCES),
}


def chain(outcomes: Sequence[bool], probability: float, persistence: float, seen_there: float) -> float:
    """Of detections and misses of an object that exists, summed over whether it was detectable in each keyframe."""
    hit = max(0.9, probability)
    share, total = probability / hit, 0.0
    for states in product((0.0, 1.0), repeat=len(outcomes)):
        weight, before = 1.0, share
        for detectable, seen in zip(states, outcomes, strict=True):
            expected = share + persistence * (before - share)
            weight *= expected if detectable else 1.0 - expected
            detected = detectable * hit * seen_there
            weight *= detected if seen else 1.0 - detected
            before = detectable
        total += weight
    return total


def joint(outcomes: np.ndarray) -> np.ndarray:
    """(2, 2, 2) P(outcomes, setting) of two objects, (K, 2) seen or not, that may not exist."""
    found = np.zeros((len(PROBABILITIES), len(HALF_RANGES), len(PERSISTENCES)))
    for i, j, m in np.ndindex(found.shape):
        found[i, j, m] = 1.0 / found.size
        for seen, reach, exists in zip(outcomes.T, RANGES, EXISTENCE, strict=True):
            there = chain(seen.tolist(), PROBABILITIES[i], PERSISTENCES[m], 0.5 ** ((reach / HALF_RANGES[j]) ** 2))
            found[i, j, m] *= exists * there + (1.0 - exists) * (not seen.any())
    return found


@pytest.mark.parametrize("seed", range(6))
def test_the_belief_is_the_sum_over_settings_and_hidden_states(seed: int) -> None:
    """Of two objects of a map, near and far, one of which may never be seen."""
    outcomes = np.random.default_rng(seed).random((5, 2)) < (0.6, 0.3)
    region = {"field_of_view_rad": 2.0, "max_range_m": 6.0, "occluder_radius_m": 0.0}
    rates = {"clutters_per_frame": [1e-9], "birth_densities": [1e-9], "least_existence": 0.0}
    settings = Configuration.of(
        association="open", semantic_model={"kind": "none"}, open_world={**GRID, **region, **rates}
    )
    placed = [
        replace(ObjectPrior.planar(n, reach, 0.0, sigma_m=1e-4, sigma_rad=1.0), existence=exists)
        for n, (reach, exists) in enumerate(zip(RANGES, EXISTENCE, strict=True))
    ]
    engine = Engine(settings, MapPrior(tuple(placed)), initial_covariance=np.diag([1e-8] * 3))
    geometry = 0.0
    for k, seen in enumerate(outcomes):
        sights = [
            Detection(range_m=reach, bearing_rad=0.0, covariance=np.diag([0.1, 0.03]) ** 2)
            for reach, there in zip(RANGES, seen, strict=True)
            if there
        ]
        geometry -= len(sights) * np.log(2.0 * np.pi * 0.1 * 0.03)
        belief = engine.process(Keyframe.planar(k, detections=sights, motion_sigmas=(1e-6,) * 3))
    expected = joint(outcomes)
    assert engine.log_evidence == pytest.approx(geometry + np.log(expected.sum()), abs=5e-4)
    share = expected / expected.sum()
    values = dict(zip(belief.noise_names, belief.noise_values, strict=True))
    assert values["open_world.detection_probability"] == pytest.approx(share.sum(axis=(1, 2)) @ PROBABILITIES, abs=5e-4)
    assert values["open_world.detection_half_range_m"] == pytest.approx(share.sum(axis=(0, 2)) @ HALF_RANGES, abs=1e-3)
    assert values["open_world.miss_persistence"] == pytest.approx(share.sum(axis=(0, 1)) @ PERSISTENCES, abs=5e-4)
    for n, seen in enumerate(outcomes.T):
        unseen = [
            expected[i, j, m]
            * (1.0 - EXISTENCE[n])
            / (EXISTENCE[n] * chain(seen.tolist(), p, q, 0.5 ** ((RANGES[n] / h) ** 2)) + (1.0 - EXISTENCE[n]))
            for (i, p), (j, h), (m, q) in product(*map(enumerate, (PROBABILITIES, HALF_RANGES, PERSISTENCES)))
        ]
        ghost = 0.0 if seen.any() else sum(unseen) / expected.sum()
        assert belief.existence[n] == pytest.approx(1.0 - ghost, abs=5e-4)


@pytest.mark.long
@pytest.mark.parametrize("share", [0.0, 0.2], ids=["all stands still", "some may move"])
def test_evidence_is_the_average_over_the_settings(share: float) -> None:
    """With births, false alarms and things that move: without merging and pruning, each setting run alone."""

    def evidence_of(**settings: Any) -> float:
        room = make_room(
            3,
            clutter=0.05,
            detection_probability=0.5,
            seed=2,
            open_world={**GRID, "merge_position_m": 0.0, "occluder_radius_m": 0.0, "least_existence": 0.0, **settings},
            moving={"share": share, "speeds_m_s": [0.5]},
            weights={"max_candidates": 2000, "gate": 1e3},
            pruning={"ratio": 1e100, "max_hypotheses": 100000},
        )
        engine = Engine.of_run(room.run, InProcessPool(1))
        for keyframe in room.keyframes:
            engine.process(keyframe)
        return engine.log_evidence

    alone = [
        evidence_of(
            detection_probabilities=[p],
            detection_half_ranges_m=[h],
            miss_persistences=[m],
            birth_densities=[b],
            clutters_per_frame=[c],
        )
        for p, h, m, b, c in product(
            PROBABILITIES, HALF_RANGES, PERSISTENCES, GRID["birth_densities"], GRID["clutters_per_frame"]
        )
    ]
    expected = np.logaddexp.reduce(alone) - np.log(len(alone))
    assert evidence_of() == pytest.approx(expected, abs=1e-6)
    assert np.ptp(alone) > 1.0


def test_settings_that_weigh_nothing_are_given_up() -> None:
    rates = DetectionRates.of(OpenWorldConfiguration(detection_probabilities=(0.1, 0.5, 0.9)))
    _, log_weights = rates.explained(np.log([1.0, 0.5, 1e-8]))
    left, kept = rates.reweighed(log_weights)
    assert kept.tolist() == [True, True, False]
    np.testing.assert_allclose(left.weights, [2.0 / 3.0, 1.0 / 3.0])
    assert left.moments("probability") == pytest.approx((0.7 / 3.0, 0.4 * np.sqrt(2.0) / 3.0))


def test_at_the_half_range_half_as_much_is_detected() -> None:
    rates = DetectionRates.of(OpenWorldConfiguration(detection_half_ranges_m=(2.0, 5.0)))
    np.testing.assert_allclose(rates.fall_off(np.array([0.0, 2.0, 4.0]))[:, 0], [1.0, 0.5, 0.0625])
    everywhere = DetectionRates.of(OpenWorldConfiguration())
    np.testing.assert_array_equal(everywhere.fall_off(np.array([0.0, 1e3])), 1.0)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.2])
def test_a_lineage_is_rebuilt_with_its_settings(share: float) -> None:
    room = make_room(14, 0, clutter=0.05, detection_probability=0.6, open_world=GRID, moving={"share": share})
    whole = Engine.of_run(room.run, InProcessPool(2))
    divided = Engine.of_run(room.run, ForgetfulPool(2))
    for keyframe in room.keyframes:
        assert_same(divided.process(keyframe), whole.process(keyframe))


def test_a_range_that_is_none_is_named() -> None:
    room = {"association": "open", "semantic_model": {"kind": "none"}}
    with pytest.raises(InputError, match="detection_half_ranges_m"):
        Engine(Configuration.of(**room, open_world={"detection_half_ranges_m": [1e-300, 3.0]}))


def test_a_crowd_at_the_start_does_not_settle_how_much_there_is_elsewhere() -> None:
    """Ten times fewer objects are 20 nats behind where the robot starts, and ahead once it has seen empty ground."""
    region = {"field_of_view_rad": 1.5, "max_range_m": 4.0, "occluder_radius_m": 0.0}
    settings = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={"birth_densities": [0.1, 1.0], "rates_ratio": 1e12, **region},
    )
    engine, crowd = Engine(settings, initial_covariance=np.diag([1e-6] * 3)), []
    for row, reach in enumerate((1.0, 1.6, 2.2, 2.8)):
        for bearing in np.linspace(-0.6, 0.6, 4):
            crowd.append(
                Detection(range_m=reach + 0.05 * row, bearing_rad=bearing, covariance=np.diag([0.02, 0.01]) ** 2)
            )
    densities = []
    for k in range(16):
        keyframe = Keyframe.planar(
            k,
            motion=(0.0, 0.0, 0.0) if k == 0 else (3.0, 0.0, 0.0),
            detections=crowd if k == 0 else [],
            motion_sigmas=(1e-3,) * 3,
        )
        belief = engine.process(keyframe)
        densities.append(dict(zip(belief.noise_names, belief.noise_values, strict=True))["open_world.birth_density"])
    assert densities[0] == pytest.approx(1.0, abs=1e-5)
    assert densities[-1] == pytest.approx(0.1, abs=0.01)

"""Hypotheses that differ in how noisy odometry is: evidence decides, and a lineage says which one it began with."""

import dataclasses

import numpy as np
import pytest
from worlds.drives.noise_roots import engine_after, weights_of_roots
from worlds.drives.open_room import Room, make_room
from worlds.same_beliefs import assert_same

from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.models.noise.noise_settings import shares_of_odometry
from semantic_slam.inference.pool import InProcessPool

FACTORS = [1.0, 16.0]


def room_of(factors: list[float], num_keyframes: int, share: float, ratio: float = 150.0, **open_world: float) -> Room:
    """A room whose odometry says ``share`` of its covariance."""
    room = make_room(
        num_keyframes,
        clutter=0.05,
        odometry={"noise_factors": factors},
        open_world=open_world,
        pruning={"ratio": ratio, "max_hypotheses": 60},
    )
    keyframes = [
        dataclasses.replace(keyframe, odometry_covariance=share * keyframe.odometry_covariance)
        for keyframe in room.keyframes
    ]
    return dataclasses.replace(room, keyframes=keyframes)


def test_evidence_is_the_average_over_the_noises() -> None:
    """Without merging and with next to nothing pruned each noise has a belief of its own."""
    alone = [engine_after(room_of([factor], 3, 1.0, 1e9, merge_position_m=0.0)).log_evidence for factor in FACTORS]
    both = engine_after(room_of(FACTORS, 3, 1.0, 1e9, merge_position_m=0.0))
    assert both.log_evidence == pytest.approx(np.logaddexp(*alone) - np.log(2.0), abs=1e-6)
    expected = np.exp(alone - np.logaddexp(*alone))
    np.testing.assert_allclose(weights_of_roots(both, len(FACTORS)), expected, atol=1e-6)


def test_odometry_that_is_better_than_configured_needs_very_strong_evidence() -> None:
    factors = [0.1, 1.0]
    alone = [engine_after(room_of([factor], 3, 1.0, 1e9, merge_position_m=0.0)).log_evidence for factor in factors]
    both = engine_after(room_of(factors, 3, 1.0, 1e9, merge_position_m=0.0))
    np.testing.assert_allclose(shares_of_odometry(factors), [1.0 / 151.0, 150.0 / 151.0])
    assert both.log_evidence == pytest.approx(np.logaddexp(*(alone + np.log(shares_of_odometry(factors)))), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "right"), [(1.0, 0), (1.0 / 16.0, 1)], ids=["honest", "too sure"])
def test_evidence_finds_the_noise(share: float, right: int) -> None:
    """Copies merge on the way, but never across noises."""
    assert weights_of_roots(engine_after(room_of(FACTORS, 30, share)), len(FACTORS))[right] > 0.95


@pytest.mark.slow
def test_a_lineage_is_rebuilt_under_its_noise() -> None:
    room = room_of(FACTORS, 12, 0.25)
    whole, divided = (Engine.of_run(room.run, pool) for pool in (InProcessPool(2), ForgetfulPool(2)))
    for keyframe in room.keyframes:
        assert_same(divided.process(keyframe), whole.process(keyframe))
    assert {live.lineage[0].mode for live in whole.live.values()} == {0, 1}


def test_what_cannot_work_is_refused() -> None:
    for factors in ([], [1.0, 0.0]):
        with pytest.raises(InputError, match="noise_factors"):
            make_room(1, odometry={"noise_factors": factors})
    with pytest.raises(InputError, match="noise_factors"):
        make_room(1, odometry={"noise_factors": FACTORS}, association="given")

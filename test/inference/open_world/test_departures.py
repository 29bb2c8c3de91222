"""Objects that leave: what was there and is not detected any more is missing, by Bayes' rule."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from worlds.drives.open_room import make_room
from worlds.same_beliefs import assert_same

from semantic_slam import Configuration, Detection, Engine, InputError, Keyframe
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

DETECTED, PER_HOUR, HIT = 0.6, 30.0, 0.9
LEAVES = 1.0 - np.exp(-PER_HOUR / 3600.0)
"""Probability that an object leaves within a second."""
SETTINGS = {
    "detection_probability": DETECTED,
    "clutter_per_frame": 0.01,
    "departures_per_hour": PER_HOUR,
    "field_of_view_rad": 2.0,
    "max_range_m": 6.0,
}
EXISTS = 0.8
AHEAD = ObjectPrior.planar(0, 3.0, 0.0, sigma_m=0.1, sigma_rad=0.3, existence=EXISTS)


def stare(seen: list[bool], map_prior: MapPrior | None = None, **settings: float) -> HybridBelief:
    """The belief of a robot at rest that looks once a second at where an object stands, or stood."""
    chosen = Configuration.of(association="open", semantic_model={"kind": "none"}, open_world=SETTINGS | settings)
    engine = Engine(chosen, map_prior)
    for k, is_seen in enumerate(seen):
        detections = [Detection.at(3.0, 0.0)] if is_seen else []
        belief = engine.process(Keyframe.planar(k, detections=detections))
    return belief


def log_missed_while_there(times: int, persistence: float) -> float:
    """Of an object that was detected the second before, over all runs of being detectable and hidden."""
    share = DETECTED / HIT if persistence else 1.0
    hit = HIT if persistence else DETECTED
    total = 0.0
    for hidden in product([False, True], repeat=times):
        probability, before = 1.0, False
        for now in hidden:
            detectable = share + persistence * ((not before) - share)
            probability *= 1.0 - detectable if now else detectable * (1.0 - hit)
            before = now
        total += probability
    return float(np.log(total))


@pytest.mark.parametrize("persistence", [0.0, 0.7])
def test_what_is_not_seen_any_more_has_left_as_the_sum_over_all_departures_says(persistence: float) -> None:
    for misses in (1, 3, 6):
        belief = stare([True] * 4 + [False] * misses, miss_persistence=persistence)
        there = (1.0 - LEAVES) ** misses * np.exp(log_missed_while_there(misses, persistence))
        gone = sum((1.0 - LEAVES) ** n * LEAVES * np.exp(log_missed_while_there(n, persistence)) for n in range(misses))
        assert belief.missing[0] == pytest.approx(gone / (there + gone), rel=1e-3)
        assert belief.existence[0] == pytest.approx(there / (there + gone), rel=1e-3)


def test_what_is_seen_again_has_not_left() -> None:
    doubted = stare([True] * 3 + [False] * 3)
    assert doubted.missing[0] > 0.1
    belief = stare([True] * 3 + [False] * 3 + [True])
    assert belief.missing[0] == 0.0
    assert belief.existence[0] == pytest.approx(1.0, abs=1e-9)


def test_what_surely_stood_there_stays_on_the_map_as_missing() -> None:
    belief = stare([True] * 3 + [False] * 30)
    assert belief.object_ids.tolist() == [0]
    assert belief.missing[0] > 0.99
    assert belief.existence[0] < 1e-6


def test_what_a_map_has_may_have_left_before() -> None:
    """P(gone | n misses) = q e / (q e + (1 - e) + (1 - q) e (1 - p)^n), by the map's existence e and the share q."""
    share, exists = 0.1, EXISTS
    prior = MapPrior((AHEAD,))
    for misses in (1, 2, 8):
        belief = stare([False] * misses, prior, departures_per_hour=0.0, departed_share=share)
        there = (1.0 - share) * exists * (1.0 - DETECTED) ** misses
        gone = share * exists
        total = there + gone + 1.0 - exists
        assert belief.missing[0] == pytest.approx(gone / total, rel=1e-3)
        assert belief.existence[0] == pytest.approx(there / total, rel=1e-3)


def test_nothing_leaves_by_default() -> None:
    assert np.isnan(stare([True, True, False], departures_per_hour=0.0).missing).all()


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("leaves", [{"departures_per_hour": PER_HOUR}, {"departures_by_label": ["object=30"]}])
def test_departures_are_the_same_however_the_work_is_divided(leaves: dict[str, Any]) -> None:
    room = make_room(14, seed=0, open_world=leaves)

    def beliefs(pool: object) -> list[HybridBelief]:
        engine = Engine.of_run(room.run, pool)
        return [engine.process(keyframe) for keyframe in room.keyframes]

    expected = beliefs(InProcessPool(1))
    assert np.isfinite(expected[-1].missing).any()
    for pool in (InProcessPool(2), ForgetfulPool(2)):
        for first, second in zip(beliefs(pool), expected, strict=True):
            assert_same(first, second)


def stare_at(label: str) -> HybridBelief:
    """Half a minute at where something that is called so was seen."""
    chosen = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world=SETTINGS | {"departures_per_hour": 0.0, "departures_by_label": ["Robot=30"], "max_range_m": 4.0},
    )
    engine, belief = Engine(chosen), None
    for k in range(4):
        sight = Detection(range_m=3.0, bearing_rad=0.0, covariance=np.diag([0.1, 0.03]) ** 2, label=label, score=0.9)
        engine.process(Keyframe.planar(k, detections=[sight]))
    for k in range(4, 34):
        belief = engine.process(Keyframe.planar(k, motion=(3.0 if k == 4 else 0.0, 0.0, 0.0)))
    assert belief is not None
    return belief


def test_what_leaves_soon_by_its_label_does_and_the_rest_stays() -> None:
    """Behind a robot that does not look back nothing tells but time."""
    robot, post = stare_at("robot"), stare_at("post")
    assert robot.existence[0] == pytest.approx((1.0 - LEAVES) ** 30, abs=1e-3)
    assert robot.missing[0] == pytest.approx(1.0 - (1.0 - LEAVES) ** 30, abs=1e-3)
    assert post.existence[0] == pytest.approx(1.0, abs=1e-3) and post.missing[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("association", ["open", "given"])
@pytest.mark.parametrize("entry", ["robot", " =3", "robot=-1", "robot=fast", "robot=inf"])
def test_a_rate_that_is_none_is_named(entry: str, association: str) -> None:
    """Before a run, by whoever announces it."""
    with pytest.raises(InputError, match="departures_by_label"):
        Engine(Configuration.of(association=association, open_world={"departures_by_label": [entry]}))


def test_what_may_move_and_is_seen_once_leaves_as_far_as_it_stands() -> None:
    """Seen once by a robot that drives on: what moves is somewhere, what stands may have left."""
    chosen = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world=SETTINGS | {"iterate_updates": False, "max_range_m": 4.0},
        moving={"share": 0.4},
    )
    engine = Engine(chosen)
    for k in range(31):
        sights = [Detection.at(3.0, 0.0)] if k == 0 else []
        belief = engine.process(Keyframe.planar(k, detections=sights, motion=(3.0 if k == 1 else 0.0, 0.0, 0.0)))
        if k == 0:
            born, share = float(belief.existence[0]), 0.4
    stays = (1.0 - LEAVES) ** 30
    assert belief.existence[0] == pytest.approx(born * (share + (1.0 - share) * stays), abs=0.01)
    assert belief.missing[0] == pytest.approx(born * (1.0 - share) * (1.0 - stays), abs=0.01)

"""What a belief tells besides its hypotheses: evidence, discarded mass lately, probabilities of associations."""

import numpy as np
import pytest
from worlds.drives.open_room import make_room
from worlds.scenes.planar_world import make_world

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.hypotheses import RECENT_KEYFRAMES
from semantic_slam.inference.marginals import association_probabilities
from semantic_slam.inference.pool import InProcessPool


@pytest.fixture(scope="module")
def closed() -> tuple[Engine, list[HybridBelief]]:
    world = make_world(14, pruning={"ratio": 30.0})
    manager = Engine.of_run(world.run, InProcessPool(1))
    return manager, [manager.process(keyframe) for keyframe in world.keyframes]


@pytest.fixture(scope="module")
def opened() -> tuple[Engine, list[HybridBelief]]:
    room = make_room(10, seed=0)
    manager = Engine.of_run(room.run, InProcessPool(1))
    return manager, [manager.process(keyframe) for keyframe in room.keyframes]


def test_the_evidence_of_all_keyframes_adds_up_to_that_of_the_run(
    closed: tuple[Engine, list[HybridBelief]],
) -> None:
    manager, beliefs = closed
    assert sum(belief.log_evidence for belief in beliefs) == pytest.approx(manager.log_evidence, abs=1e-9)


def test_the_window_holds_the_last_keyframes_alone(closed: tuple[Engine, list[HybridBelief]]) -> None:
    beliefs = closed[1]
    kept = np.array([1.0 - belief.discarded_mass for belief in beliefs])
    assert len(beliefs) > RECENT_KEYFRAMES and kept[-1] < 1.0
    for belief in beliefs[:RECENT_KEYFRAMES]:
        assert belief.discarded_mass_window == pytest.approx(belief.discarded_mass, abs=1e-12)
    expected = 1.0 - kept[-1] / kept[-1 - RECENT_KEYFRAMES]
    assert beliefs[-1].discarded_mass_window == pytest.approx(expected, abs=1e-12)


def test_association_probabilities_are_the_weights_of_the_hypotheses_that_associate_so(
    closed: tuple[Engine, list[HybridBelief]],
) -> None:
    for belief in closed[1]:
        weights, columns = np.exp(belief.log_weights), np.arange(-1, len(belief.object_ids))
        for own, found in zip(belief.associations.T, belief.association_probabilities, strict=True):
            expected = [weights[own == column].sum() for column in (*columns[1:], -1)]
            np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_detection_that_starts_an_object_is_not_associated_with_it_yet(
    opened: tuple[Engine, list[HybridBelief]],
) -> None:
    manager, beliefs = opened
    again = 0.0
    for belief in beliefs:
        np.testing.assert_allclose(belief.association_probabilities.sum(axis=1), 1.0, atol=1e-12)
        new = belief.object_ids >= manager.registry.first_new_id(belief.keyframe)
        assert not belief.association_probabilities[:, :-1][:, new].any()
        again += belief.association_probabilities[:, :-1].sum()
    first = beliefs[0]
    assert len(first.detection_ids) and np.all(first.association_probabilities[:, -1] == pytest.approx(1.0))
    assert again > 5.0


def test_association_probabilities_do_not_hang_on_how_many_hypotheses_are_followed() -> None:
    """What the second keyframe of a room is of, with every continuation of the first one's hypotheses and with two."""
    found = []
    for most in (1000, 2):
        room = make_room(2, seed=3, pruning={"max_hypotheses": most, "ratio": 1e6})
        manager = Engine.of_run(room.run, InProcessPool(1))
        belief = [manager.process(keyframe) for keyframe in room.keyframes][-1]
        names = belief.object_ids.tolist()
        found.append((len(belief.hypothesis_ids), names, belief.association_probabilities))
    (all_followed, every, exact), (followed, some, probabilities) = found
    assert all_followed > 2 == followed
    shared = [n for n in some if n in every]
    assert probabilities[:, [some.index(n) for n in shared]].sum() > 1.0
    for n in shared:
        np.testing.assert_allclose(probabilities[:, some.index(n)], exact[:, every.index(n)], atol=1e-9)


def test_association_probabilities_of_no_detections() -> None:
    assert association_probabilities(np.ones(1), np.zeros((1, 0), dtype=np.int32), 3).shape == (0, 4)


def test_what_no_model_fills_yet_is_nan(closed: tuple[Engine, list[HybridBelief]]) -> None:
    belief = closed[1][-1]
    count = len(belief.object_ids)
    assert belief.object_velocities.shape == (count, 6) and belief.moving.shape == (count,)
    for values in (belief.object_velocities, belief.moving, belief.moved, belief.missing):
        assert np.isnan(values).all()
    assert belief.state_space == "planar" and belief.noise_names == ()

"""A thing whose first boxes are halves is one: a history without the other half weighs what all histories say."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from worlds.same_beliefs import assert_same

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe
from semantic_slam.errors import InputError
from semantic_slam.inference.revision.hindsight.beside import seldom_beside
from semantic_slam.inference.revision.hindsight.dissolved import each_without
from semantic_slam.inference.revision.hindsight.planar import PlanarHindsight
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.states.lineage import LineageStep

Frame = Sequence[tuple[float, float]]
WHOLE: Frame = [(2.0, 0.0)]
HALVES: Frame = [(2.0, 0.17), (2.0, -0.17)]
EVERY_HISTORY = {"pruning": {"max_hypotheses": 300, "ratio": 1e12}, "weights": {"gate": 60.0}}


def configuration(every: int, world: dict[str, float] | None = None, **others: dict[str, float]) -> Configuration:
    rates = {"detection_probability": 0.98, "second_box_share": 0.05}
    return Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world=rates | (world or {}),
        revision={"second_boxes_every_keyframes": every},
        **others,
    )


def driven(frames: Sequence[Frame], settings: Configuration, backends: int = 1) -> tuple[Engine, list[HybridBelief]]:
    """A robot at rest."""
    engine, beliefs = Engine(settings, backends=backends), []
    for k, frame in enumerate(frames):
        detections = [Detection.at(*place) for place in frame]
        beliefs.append(engine.process(Keyframe.planar(k, detections=detections, motion_sigmas=(1e-3, 1e-3, 1e-3))))
    return engine, beliefs


def num_things(frames: Sequence[Frame], settings: Configuration) -> float:
    """Expected number of things at the end."""
    return float(driven(frames, settings)[1][-1].existence.sum())


def test_a_half_is_doubted_as_much_as_by_all_histories_together() -> None:
    frames = [HALVES] * 2 + [WHOLE] * 2
    every_history = num_things(frames, configuration(0, {"merge_position_m": 0.0}, **EVERY_HISTORY))
    assert every_history == pytest.approx(1.41, abs=0.02)
    assert num_things(frames, configuration(0)) == pytest.approx(1.56, abs=0.02)  # the right histories were given up
    assert num_things(frames, configuration(1)) == pytest.approx(every_history, abs=0.2)
    assert num_things([*frames, WHOLE], configuration(1)) == pytest.approx(1.01, abs=0.02)


def test_things_that_stand_together_are_two_to_the_bit() -> None:
    frames = [HALVES, HALVES, HALVES, WHOLE, HALVES, HALVES, HALVES, HALVES]
    without, looking = (driven(frames, configuration(every))[1] for every in (0, 1))
    for one, other in zip(looking, without, strict=True):
        assert_same(one, other)


def test_halves_of_a_thing_that_came_later_are_of_that() -> None:
    """The half is the older one, and was seen without the thing."""
    frames = [HALVES[:1], HALVES, HALVES, *[[(2.0, -0.1)]] * 4]
    belief = driven(frames, configuration(1))[1][-1]
    assert belief.existence.max() > 0.97 and belief.existence.sum() < 1.1


@pytest.mark.long
def test_backends_make_no_difference() -> None:
    frames = [HALVES] * 2 + [WHOLE] * 4
    one, three = (driven(frames, configuration(2), backends)[1] for backends in (1, 3))
    for own, other in zip(one, three, strict=True):
        assert_same(own, other)


def test_what_a_history_roughly_gains_is_what_a_replay_says() -> None:
    engine, _ = driven([HALVES] * 2 + [WHOLE] * 3, configuration(10**6))
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps, engine.registry)
    own = next(iter(engine.live.values())).lineage
    names = own[0].association
    half = next(n for n in names if n not in own[-1].association)
    born = [engine.registry.first_new_id(k) for k in range(len(own))]
    single = tuple(
        replace(s, association=tuple(born[k] + i if n == half else n for i, n in enumerate(s.association)))
        for k, s in enumerate(own)
    )
    followed, without = map(replay.followed, (own, single))
    assert followed is not None and without is not None
    view = PlanarHindsight.of(replay, engine.registry, followed)
    (rough,) = [found.gain for found in each_without(view) if view.ids[found.row] == half]
    assert rough == pytest.approx(without.log_joint - followed.log_joint, abs=3.0)


def test_what_is_hardly_ever_missed_or_called_otherwise_is_no_suspect() -> None:
    places = {0: np.zeros(3), 1: np.array([0.4, 0.0, 0.0]), 2: np.array([5.0, 0.0, 0.0])}
    chair, maybe, cup = np.array([0.9, 0.1]), np.array([0.6, 0.4]), np.array([0.1, 0.9])
    lineage = tuple(LineageStep(own, (-1,) * len(own)) for own in [(0, 1), (0,), (0, 2), (0,), (0, 1)])
    of_none = dict.fromkeys(places, np.zeros(0))
    assert seldom_beside(places, of_none, lineage, second_box_m=0.3) == {1}
    assert seldom_beside(places, of_none, lineage[:1] * 5 + lineage, second_box_m=0.3) == set()
    assert seldom_beside(places, of_none, lineage, second_box_m=0.1) == set()
    assert seldom_beside(places, {0: chair, 1: maybe, 2: chair}, lineage, second_box_m=0.3) == {1}
    assert seldom_beside(places, {0: chair, 1: cup, 2: chair}, lineage, second_box_m=0.3) == set()


def test_poses_that_a_look_back_replays_stay() -> None:
    with pytest.raises(InputError, match=r"revision\.horizon"):
        Engine(configuration(5, history={"horizon_keyframes": 100}))


def test_where_identities_are_given_there_is_nothing_to_look_for() -> None:
    engine = Engine(Configuration.of(association="given", revision={"second_boxes_every_keyframes": 5}))
    assert not engine.revision.is_on

"""An engine made again, with the state of one that was under way, goes on to the bit, in whatever world it is."""

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np
import pytest
from semantic_slam_lab.soak.robots import map_of as map_of_tour
from semantic_slam_lab.soak.robots import robot
from semantic_slam_lab.soak.tour import Tour
from worlds.living_pool import LivingPool
from worlds.same_beliefs import assert_same
from worlds.scenes.labelled_looks import by_labels_and_vectors, with_labels_and_vectors
from worlds.scenes.lost_world import configuration as lost_configuration
from worlds.scenes.lost_world import make_world, map_of
from worlds.scenes.rounds import START_SIGMAS, Rounds

from semantic_slam import Configuration, Engine, Keyframe
from semantic_slam.inference.building import make_run_configuration, start_of_run
from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.world.map_prior import MapPrior

HORIZON = 20


class World(NamedTuple):
    """A run, the keyframes before its engine is made again, and those after."""

    run: RunConfiguration
    before: list[Keyframe]
    after: list[Keyframe]


def told(
    configuration: Configuration, prior: MapPrior | None, every: list[Keyframe], count: int, **start: object
) -> World:
    pose, covariance = start_of_run(configuration, start.get("pose"), start.get("covariance"))  # type: ignore[arg-type]
    return World(
        make_run_configuration(configuration, prior, pose, covariance, stamp_ns=1), every[:count], every[count:]
    )


def in_space() -> World:
    settings = {"observation": "points", "semantic_model": {"kind": "none"}, "state_space": "spatial"}
    configuration = Configuration.of(association="given", history={"horizon_keyframes": HORIZON}, **settings)
    every = Rounds(0, 6, has_depth=True, are_named=True).keyframes(32)
    return told(configuration, None, every, 26, pose=Rounds.pose(0), covariance=np.diag(START_SIGMAS**2))


def toured(configuration: Configuration, prior: MapPrior | None = None, count: int = 26) -> World:
    weights = replace(configuration.weights, max_history=HORIZON // 2)
    configuration = replace(configuration, weights=weights)
    every = [seen.keyframe for seen in islice(Tour(configuration).keyframes(), count + 7)]
    return told(configuration, prior, every, count)


def on_a_map() -> World:
    return toured(replace(robot("given", HORIZON), association="enumerated"), map_of_tour("map"))


def learning_its_region_and_scores() -> World:
    """With scores, which the tour has not."""
    own = robot("open", HORIZON)
    own = replace(own, open_world=replace(own.open_world, learn_region=True, learn_scores=True, field_of_view_rad=1.3))
    own = replace(own, revision=replace(own.revision, carried_probability=0.0))
    made, random = toured(own), np.random.default_rng(0)

    def scored(keyframe: Keyframe) -> Keyframe:
        scores = random.uniform(0.2, 0.95, len(keyframe.measurements.scores))
        return replace(keyframe, measurements=replace(keyframe.measurements, scores=scores))

    return made._replace(before=[*map(scored, made.before)], after=[*map(scored, made.after)])


def of_labels_and_vectors() -> World:
    own = robot("open", HORIZON)
    return labelled(replace(own, revision=replace(own.revision, carried_probability=0.0)))


def labelled(configuration: Configuration, prior: MapPrior | None = None, count: int = 26) -> World:
    made = toured(by_labels_and_vectors(configuration), prior, count)
    before, after = ([with_labels_and_vectors(keyframe) for keyframe in part] for part in (made.before, made.after))
    return made._replace(before=before, after=after)


def of_labels_and_vectors_where_the_robot_may_be_carried() -> World:
    """On a map, where histories may be replayed from before through what was seen then."""
    return labelled(robot("session", 40), map_of_tour("session"), count=56)


def where_the_robot_may_be_carried() -> World:
    """Where it is too late to be searched for, and its suspected kidnappings are out of a replay's reach."""
    own = robot("open", 40)
    return toured(replace(own, revision=replace(own.revision, horizon=8)), count=105)


def lost_in_a_map() -> World:
    """Beyond the horizon of revisions it is not searched for any more."""
    revision = {"lost_every_keyframes": 2, "horizon": 20}
    configuration = lost_configuration(
        history={"horizon_keyframes": 20}, weights={"max_history": 10}, revision=revision
    )
    every = make_world(np.array([1.0, -2.0, 0.7]), 32).keyframes
    return told(configuration, map_of(), every, 27)


WORLDS = (
    in_space,
    on_a_map,
    learning_its_region_and_scores,
    of_labels_and_vectors,
    of_labels_and_vectors_where_the_robot_may_be_carried,
    pytest.param(where_the_robot_may_be_carried, marks=pytest.mark.slow),
    lost_in_a_map,
)


@pytest.mark.long
@pytest.mark.parametrize("make_world_of", WORLDS, ids=lambda made: made.__name__)
def test_an_engine_made_again_with_its_state_goes_on_to_the_bit(make_world_of: Callable[[], World]) -> None:
    world = make_world_of()
    undisturbed = Engine.of_run(world.run, InProcessPool(1))
    expected = [undisturbed.process(keyframe) for keyframe in [*world.before, *world.after]][len(world.before) :]
    pool = InProcessPool(1)
    first = Engine.of_run(world.run, pool)
    for keyframe in world.before:
        first.process(keyframe)
    assert first.may_be_stored
    again = Engine.of_run(world.run, LivingPool(pool))
    again.restore(unpacked(packed(first.state())))
    for keyframe, belief in zip(world.after, expected, strict=True):
        assert_same(again.process(keyframe), belief)
    assert again.log_evidence == undisturbed.log_evidence
    assert packed(again.state()) == packed(undisturbed.state())


def test_an_engine_that_revises_histories_is_not_stored_before_its_horizon() -> None:
    configuration = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        revision={"every_keyframes": 5, "horizon": 3},
    )
    engine, seen = Engine(configuration), []
    for index in range(5):
        engine.process(Keyframe.planar(index, motion=(0.1, 0.0, 0.0)))
        seen.append(engine.may_be_stored)
    assert seen == [False, False, False, True, True]


def test_a_keyframe_from_before_a_restart_cannot_be_asked_for() -> None:
    configuration = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        revision={"every_keyframes": 5, "horizon": 1},
    )
    engine = Engine(configuration)
    for index in range(3):
        engine.process(Keyframe.planar(index, motion=(0.1, 0.0, 0.0)))
    again = Engine(configuration)
    again.restore(unpacked(packed(engine.state())))
    assert len(again.steps) == 3
    with pytest.raises(LostComponentError, match="keyframe 1 was forgotten at a restart"):
        again.steps[1]

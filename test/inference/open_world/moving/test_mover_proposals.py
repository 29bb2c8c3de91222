"""Histories in which what stood still is one object that moves: the right ones are proposed, and weigh more."""

import pytest
from worlds.drives.moving_world import configuration, make_world, objects_of, run

from semantic_slam.inference.engine import Engine
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.open_world.moving.mover_proposals import (
    mover_proposals,
    standing_proposals,
    with_mover,
    with_standing,
)
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.states.lineage import MOVES
from semantic_slam.inference.states.movers import Movers


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_what_a_blind_history_took_for_ghosts_is_proposed_and_weighs_more(seed: int) -> None:
    world = make_world(20, seed=seed)
    blind, _ = run(world, configuration(0.0))
    knowing = Engine(configuration(0.1))
    lineage, names = next(iter(blind.live.values())).lineage, objects_of(blind, world)
    steps = [blind.problem.reader.step(keyframe) for keyframe in world.keyframes]
    moving = Moving(configuration(0.1).moving)
    groups = mover_proposals(lineage, steps, world.truth, 0, moving, blind.problem.open_world.birth_density)
    assert {name for group in groups[:2] for n in group for name in names[n]} & {10, 11}
    replay = Replay(knowing.problem, knowing.association(knowing.problem, blind.registry), KeptSteps(steps))
    before, after = map(replay.followed, (lineage, with_mover(lineage, groups[0])))
    assert before is not None and after is not None
    assert after.log_joint > before.log_joint + 10.0


@pytest.mark.long
@pytest.mark.slow
def test_the_first_detection_starts_and_the_others_move() -> None:
    world = make_world(20, seed=0)
    lineage = next(iter(run(world, configuration(0.0))[0].live.values())).lineage
    seen = sorted({n for step in lineage for n in step.association})[:2]
    revised = with_mover(lineage, (seen[0], seen[1]))
    kinds = [
        kind
        for step in revised
        for n, kind in zip(step.association, step.class_assignment, strict=True)
        if n == seen[0]
    ]
    assert kinds[0] == -1 and set(kinds[1:]) == {MOVES}
    assert not any(seen[1] in step.association for step in revised)


def test_where_nothing_moves_nothing_is_proposed() -> None:
    world = make_world(20, seed=0, movers=False)
    engine, _ = run(world, configuration(0.0))
    steps = [engine.problem.reader.step(keyframe) for keyframe in world.keyframes]
    lineage, moving = next(iter(engine.live.values())).lineage, Moving(configuration(0.1).moving)
    assert mover_proposals(lineage, steps, world.truth, 0, moving, engine.problem.open_world.birth_density) == []


@pytest.mark.long
@pytest.mark.slow
def test_what_was_not_seen_lately_is_not_proposed_again() -> None:
    world = make_world(20, seed=0)
    blind, _ = run(world, configuration(0.0))
    lineage = next(iter(blind.live.values())).lineage
    steps = [blind.problem.reader.step(keyframe) for keyframe in world.keyframes]
    settled = lineage, steps, world.truth, 0, Moving(configuration(0.1).moving), blind.problem.open_world.birth_density
    assert mover_proposals(*settled)
    assert mover_proposals(*settled, since=len(steps)) == []


@pytest.mark.long
@pytest.mark.slow
def test_what_stands_and_was_taken_to_move_is_proposed_to_stand_and_weighs_more() -> None:
    world = make_world(20, seed=0)
    engine, _ = run(world, configuration(0.1))
    lineage, names = next(iter(engine.live.values())).lineage, objects_of(engine, world)
    steps = [engine.problem.reader.step(keyframe) for keyframe in world.keyframes]
    posts = [n for n, own in names.items() if not {10, 11} & set(own) and len(own) > 10]
    wrong = with_mover(lineage, (posts[0],))
    right = with_standing(wrong, (posts[0],))
    assert right == lineage
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), KeptSteps(steps))
    before, after = map(replay.followed, (wrong, right))
    assert before is not None and after is not None and after.log_joint > before.log_joint
    assert standing_proposals(wrong, movers_in(before)) == [(posts[0],)]
    assert standing_proposals(wrong, movers_in(before), since=len(steps)) == []
    assert standing_proposals(right, movers_in(after)) == []


def movers_in(history: Revised) -> Movers:
    """What may move in it."""
    assert history.component.movers is not None
    return history.component.movers

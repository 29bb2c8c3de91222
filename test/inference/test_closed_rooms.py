"""Closed worlds whose data are not what the models say: a wrong view, an object that the map lacks, a wrong barcode."""

from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.studies.faulty_rooms.closed_room import (
    ClosedRoom,
    driven,
    first_view,
    make_room,
    position_error_m,
    some_views,
    with_swapped_scores,
    without_object,
)

from semantic_slam.inference.belief import HybridBelief

KEYFRAMES, LATER = 30, 20
"""Of a drive, and those by which it is judged."""
NOTHING_WRONG = {"semantic_model": {"outlier_share": 0.0}, "closed_world": {"clutter_per_frame": 0.0}}
"""As if every detection were of an object of the map, and every view as its class has it."""


def right_share(room: ClosedRoom, belief: HybridBelief, k: int) -> float:
    """Weight of the hypotheses whose associations of keyframe ``k`` are the true ones, -1 for what no map knows."""
    known = belief.object_ids.tolist()
    truth = [n if n in known else -1 for n in room.associations[k]]
    right = (np.append(belief.object_ids.astype(int), -1)[belief.associations] == truth).all(axis=1)
    return float(np.exp(belief.log_weights[right]).sum())


def drawn_room(seed: int) -> ClosedRoom:
    """The first three quarters of a drive."""
    room = make_room(seed)
    parts = {name: getattr(room, name)[:KEYFRAMES] for name in ("keyframes", "truth", "associations")}
    return replace(room, **parts)


def is_lost(room: ClosedRoom, **configuration: object) -> bool:
    """Whether the later part of the drive is associated wrongly."""
    beliefs = driven(room, **configuration)
    return float(np.mean([right_share(room, beliefs[k], k) for k in range(LATER, len(beliefs))])) < 0.9


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("seed", [8])
def test_one_wrong_view_at_the_start_loses_no_map(seed: int) -> None:
    room = drawn_room(seed)
    wrong = with_swapped_scores(room, [first_view(room)], seed)
    assert not is_lost(wrong)
    assert is_lost(wrong, **NOTHING_WRONG)  # what it is for


@pytest.mark.long
@pytest.mark.slow
def test_wrong_views_lose_no_room_of_two() -> None:
    """One of the first views in one of them, a tenth of all in the other."""
    one, other = drawn_room(0), drawn_room(1)
    assert not is_lost(with_swapped_scores(one, [first_view(one)], 0))
    assert not is_lost(with_swapped_scores(other, some_views(other, 0.1, 1), 1))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
def test_an_object_that_the_map_lacks_is_named(seed: int) -> None:
    room = drawn_room(seed)
    counts = np.bincount([n for seen in room.associations for n in seen])
    missing = int(counts.argmax()) if seed % 2 else int(np.argsort(counts)[-3])
    room = without_object(room, missing)
    beliefs = driven(room)
    seen = [(k, i) for k, own in enumerate(room.associations) for i, n in enumerate(own) if n == missing and k >= LATER]
    others = [
        (k, i) for k, own in enumerate(room.associations) for i, n in enumerate(own) if n != missing and k >= LATER
    ]
    assert seen and all(beliefs[k].outlier_probability[i] > 0.9 for k, i in seen)
    assert all(beliefs[k].outlier_probability[i] < 0.1 for k, i in others)
    assert position_error_m(room, beliefs[-1]) < 0.5
    assert is_lost(room, **NOTHING_WRONG)


@pytest.mark.slow
def test_a_wrong_barcode_is_named_and_costs_nothing() -> None:
    room, wrong_at = drawn_room(1), (14, 0)
    named = tuple(tuple(f"object_{n}" for n in seen) for seen in room.associations)
    swapped = list(named)
    other = next(f"object_{n}" for n in range(8) if n not in room.associations[wrong_at[0]])
    swapped[wrong_at[0]] = (other, *named[wrong_at[0]][1:])
    settings = {"association": "given", "semantic_model": {"kind": "none"}}
    right, wrong = (driven(_named(room, names), **settings) for names in (named, swapped))
    assert wrong[wrong_at[0]].hypotheses[0].associations[0] == -1
    assert wrong[wrong_at[0]].outlier_probability[0] > 0.99
    errors = [position_error_m(room, beliefs[-1]) for beliefs in (right, wrong)]
    assert errors[1] < errors[0] + 0.05
    fact = driven(_named(room, swapped), **settings, closed_world={"wrong_identity_share": 0.0})
    assert max(position_error_m(room, belief) for belief in fact[wrong_at[0] :]) > errors[1] + 0.2


def _named(room: ClosedRoom, names) -> ClosedRoom:
    keyframes = [
        replace(own, measurements=replace(own.measurements, track_ids=told))
        for own, told in zip(room.keyframes, names, strict=True)
    ]
    return replace(room, keyframes=tuple(keyframes))

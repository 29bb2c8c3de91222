"""Coverage of an object's views together: false alarms mark no known object, unknown ones are told."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.scenes.planar_world import OBJECTS, beliefs, make_world

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.states.view_coverage import LOOK_RAD, NO_VIEWS, SIGNIFICANCE, ViewCoverage

FALSE_ALARMS = 0.01
NUM_OBJECTS = 8


def seen(strange: np.ndarray) -> ViewCoverage:
    """(L, V) whether each of V views in L looks is strange."""
    coverage = NO_VIEWS
    for look, views in enumerate(strange):
        for is_strange in views:
            coverage = coverage.with_view((look + 0.5) * LOOK_RAD, is_recognised=not is_strange)
    return coverage


def test_one_false_alarm_among_sixty_views_marks_no_object() -> None:
    strange = np.zeros((12, 5), dtype=bool)
    strange[3, 2] = True
    assert seen(strange).holds(FALSE_ALARMS, NUM_OBJECTS)


def test_known_objects_are_called_unknown_in_less_than_one_run_in_a_hundred_however_views_repeat() -> None:
    """Views of a look that share their fate, and views that do not."""
    generator = np.random.default_rng(0)
    for shape in ((12, 1), (12, 5)):
        runs = 400
        drawn = generator.random((runs, NUM_OBJECTS, *shape)) < FALSE_ALARMS
        strange = np.broadcast_to(drawn, (runs, NUM_OBJECTS, 12, 5))
        flagged = [not all(seen(own).holds(FALSE_ALARMS, NUM_OBJECTS) for own in run) for run in strange]
        assert np.mean(flagged) <= SIGNIFICANCE


def test_an_unknown_object_is_told_from_a_quarter_of_the_way_around_it() -> None:
    """Of its pictures 80 % are recognised as strange."""
    generator = np.random.default_rng(0)
    strange = generator.random((500, 6, 3)) < 0.8
    assert np.mean([not seen(own).holds(FALSE_ALARMS, NUM_OBJECTS) for own in strange]) >= 0.99


def test_one_direction_alone_says_as_much_as_one_view_however_often_it_is_seen() -> None:
    assert seen(np.ones((1, 50), dtype=bool)).holds(FALSE_ALARMS, NUM_OBJECTS)
    assert not seen(np.ones((2, 1), dtype=bool)).holds(FALSE_ALARMS, NUM_OBJECTS)
    assert not seen(np.ones((1, 1), dtype=bool)).holds(0.0005, NUM_OBJECTS)


def test_a_direction_that_no_model_was_fitted_on_is_no_false_alarm() -> None:
    covered = seen(np.zeros((12, 5), dtype=bool))
    assert not covered.with_view(0.0, is_recognised=True, is_fitted=False).holds(FALSE_ALARMS, NUM_OBJECTS)


def test_directions_count_modulo_a_turn() -> None:
    once, again = (NO_VIEWS.with_view(angle, is_recognised=False) for angle in (-0.1, 2.0 * np.pi - 0.1))
    assert once == again


@pytest.mark.parametrize("association", ["enumerated", "open"])
def test_the_belief_names_the_object_that_looks_strange_and_no_other(association: str) -> None:
    """Every view of one object is strange, one view of another is a false alarm."""
    world = make_world(12, sigma_start_m=0.05, association=association, semantic_model={"kind": "gp_independent"})
    assert any(1 in seen for seen in world.associations)
    is_false_alarm = True
    keyframes = []
    for keyframe, seen_objects in zip(world.keyframes, world.associations, strict=True):
        flags = np.array([number != 0 for number in seen_objects], dtype=bool)
        if 1 in seen_objects and is_false_alarm:
            flags[seen_objects.index(1)] = is_false_alarm = False
        measured = replace(keyframe.measurements, in_coverage=flags)
        keyframes.append(replace(keyframe, measurements=measured))
    last = beliefs(replace(world, keyframes=keyframes), 1)[-1]
    covered = dict(zip(last.object_ids.tolist(), last.in_coverage.tolist(), strict=True))
    near = {number: covered[nearest(last, OBJECTS[number])] for number in (0, 1, 2)}
    assert near == {0: False, 1: True, 2: True}


def nearest(belief: HybridBelief, place: np.ndarray) -> int:
    """Id of the object of a belief next to a place."""
    away = np.linalg.norm(belief.object_poses[:, :2] - place[:2], axis=1)
    return int(belief.object_ids[np.argmin(away)])

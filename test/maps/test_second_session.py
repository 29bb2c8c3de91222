"""A robot comes back to a room in which two objects were moved, one is gone and one is new; its views are drawn."""

from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.studies.faulty_rooms.closed_room import CLASSES, REACH_M, ClosedRoom, make_room

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.maps.as_prior import map_prior_of
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.differences import MapDifference, difference
from semantic_slam.maps.from_run import saved_map_of_engine
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.saved_map import SavedMap
from semantic_slam.shipped import configuration_file

SEED, KEYFRAMES = 3, 60
MOVED, GONE, NEW = {4: (0.5, -0.5), 5: (-0.6, 0.5)}, 6, (1.4, 4.9)
"""Objects by number, and how far; the new one is where it is seen, of a class that none of these has."""


KNOWN, LOST = np.array([0.1, 0.1, 0.05]), np.array([10.0, 10.0, np.pi])
"""Standard deviations of where a session begins: x, y [m] and yaw [rad]."""
OFF = np.array([6.0, -5.0, 2.0])


def map_of(
    room: ClosedRoom, configuration: Configuration, prior: MapPrior | None, sigmas: np.ndarray = KNOWN, off: float = 0.0
) -> SavedMap:
    start = room.truth[0] + off * OFF
    engine = Engine(configuration, prior, initial_pose=start, initial_covariance=np.diag(sigmas**2))
    assert isinstance(engine.pool, InProcessPool)
    for keyframe in room.keyframes:
        belief = engine.process(keyframe)
    return with_id(saved_map_of_engine(engine, engine.pool, belief))


def session() -> Configuration:
    shipped = load_configuration(configuration_file("second_session"))
    return replace(shipped, open_world=replace(shipped.open_world, max_range_m=REACH_M, occluder_radius_m=0.0))


def second_room(room: ClosedRoom) -> ClosedRoom:
    objects, classes = room.objects.copy(), list(CLASSES)
    for number, off in MOVED.items():
        objects[number, :2] += off
    objects = np.delete(np.vstack([objects, [*NEW, 1.0]]), GONE, axis=0)
    del classes[GONE]
    return make_room(SEED + 1, KEYFRAMES, objects=objects, classes=[*classes, 2])


def check(told: MapDifference) -> None:
    expected = {number: "same" for number in range(8)} | dict.fromkeys(MOVED, "displaced") | {GONE: "gone"}
    assert {own.object_id: own.kind for own in told.old} == expected
    assert min(own.probabilities[own.kind] for own in told.old) >= 0.9
    for number, off in MOVED.items():
        assert abs(told.old[number].distance_m - np.hypot(*off)) < 0.2
    (new,) = [own for own in told.new if own.probability >= 0.5]
    assert new.probability >= 0.9 and np.hypot(*(new.position - NEW)) < 0.5


def test_all_that_changed_is_named_on_the_map_and_by_a_robot_that_does_not_know_where_it_began() -> None:
    room = make_room(SEED, KEYFRAMES)
    old, later = map_of(room, Configuration(), room.prior), second_room(room)
    check(difference(Comparison.of(old, map_of(later, session(), map_prior_of(old)))))
    lost = map_of(replace(later, truth=later.truth * 0.0), session(), None)
    told = difference(Comparison.of(old, lost))
    assert not told.same_frame
    check(told)


@pytest.mark.long
def test_all_that_changed_is_named_by_a_robot_that_is_lost_on_the_map_without_a_known_heading() -> None:
    room = make_room(SEED, KEYFRAMES)
    old, later = map_of(room, Configuration(), room.prior), second_room(room)
    found = map_of(later, session(), map_prior_of(old), LOST, off=1.0)
    told = difference(Comparison.of(old, found))
    assert told.same_frame
    check(told)

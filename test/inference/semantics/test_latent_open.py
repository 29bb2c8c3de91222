"""Descriptors where no map tells how objects are turned: in an open world, and with identities given."""

import numpy as np
import pytest
from worlds.scenes.planar_world import OBJECTS
from worlds.views.harmonic_model import HarmonicModel
from worlds.views.latent_world import MODEL, ROOM, make_latent_room, make_latent_world

from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.geometry.se2 import between
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.keys import descriptor_key


def run(world):
    pool = InProcessPool(1, world.problem)
    manager = Engine.of_run(world.run, pool, world.problem)
    return [manager.process(frame) for frame in world.keyframes], manager, pool


@pytest.fixture(scope="module")
def room():
    world = make_latent_room(24, clutter=0.2)
    return world, *run(world)


@pytest.mark.long
@pytest.mark.slow
def test_objects_come_with_descriptors_and_headings(room) -> None:
    world, beliefs, _, _ = room
    final = beliefs[-1]
    sure = np.flatnonzero(final.existence > 0.9)
    poses = planar_from_pose_vector(final.object_poses)
    found = 0
    for number, place in enumerate(ROOM):
        if sum(number in labels for labels in world.associations) < 4:
            continue
        row = sure[np.argmin(np.linalg.norm(poses[sure, :2] - place[:2], axis=1))]
        assert np.linalg.norm(poses[row, :2] - place[:2]) < 0.35
        assert abs(wrap_angle(poses[row, 2] - place[2])) < 0.25
        np.testing.assert_allclose(final.descriptors[row], world.descriptors[number], atol=0.35)
        found += 1
    assert found >= 3


@pytest.mark.slow
def test_descriptors_enter_the_graph_once_the_heading_is_known(room) -> None:
    _, _, manager, pool = room
    best = max(manager.live, key=lambda n: manager.live[n].log_weight)
    component = pool._backends[0].held[best].component
    entered = [n for n in component.views if component.smoother.has(descriptor_key(n))]
    assert len(entered) >= 3
    assert component.smoother.num_descriptors >= len(entered)
    for number in entered:
        assert component.views[number].headings.pending == ()


@pytest.mark.slow
def test_what_hypotheses_lack_does_not_spoil_the_mixture(room) -> None:
    for belief in room[1]:
        assert np.isfinite(belief.descriptors).all() and (belief.descriptor_covariances >= 0.0).all()
        assert belief.descriptors.shape == (len(belief.object_ids), MODEL.num_dimensions)
        np.testing.assert_allclose(belief.class_probabilities.sum(axis=1), 1.0)


def test_given_identities_need_no_map() -> None:
    """The map floats with the robot's broad prior; relative to the first object it is the world."""
    world = make_latent_world(8, association="given")
    beliefs, manager, _ = run(world)
    final = beliefs[-1]
    poses = planar_from_pose_vector(final.object_poses)
    numbers = [int(name.removeprefix("tree_")) for name in final.object_names]
    first = numbers.index(0)
    for row, number in enumerate(numbers):
        found, true = between(poses[first], poses[row]), between(OBJECTS[0], OBJECTS[number])
        if final.descriptor_covariances[row].max() < 0.01:
            np.testing.assert_allclose(found[:2], true[:2], atol=0.4)
            assert abs(wrap_angle(found[2] - true[2])) < 0.15
            np.testing.assert_allclose(final.descriptors[row], world.descriptors[number], atol=0.3)
    assert len(manager.live) == 1
    start = planar_from_pose_vector(world.run.initial_pose)
    drift = planar_from_pose_vector(final.poses[0])[:2] - world.truth[-1][:2] - (start - np.array([-0.5, 0.0, 0.0]))[:2]
    assert np.linalg.norm(drift) < 1.0


@pytest.mark.parametrize("make", [make_latent_room, make_latent_world])
def test_a_space_without_classes_does(make) -> None:
    """Nothing is grounded: beliefs have descriptors and no classes."""
    beliefs, _, _ = run(make(4, model=HarmonicModel(class_names=())))
    final = beliefs[-1]
    assert final.class_names == () and final.class_probabilities.shape == (len(final.object_ids), 0)
    assert (final.descriptor_covariances < 0.5).any()


def test_a_map_prior_with_known_headings_needs_no_modes() -> None:
    """With a map each view enters at once."""
    world = make_latent_world(2, sigma_start_m=0.1)
    beliefs, manager, pool = run(world)
    component = pool._backends[0].held[max(manager.live, key=lambda n: manager.live[n].log_weight)].component
    assert component.views and all(views.headings is None for views in component.views.values())
    assert len(beliefs) == 2

"""A robot that does not know where it started was not carried: what it has seen is on its map."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam import Engine, MapPrior, ObjectPrior
from semantic_slam.configuration import InitialPoseConfiguration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.maps.from_belief import map_objects, mapped_rows, num_unplaced, saved_map_of_belief
from semantic_slam.shipped import configuration_file

MAPPED = [[5.0, 5.0], [-6.0, 2.0], [3.0, -7.0], [8.0, 1.0]]
SEEN = [(2.0, 0.3), (2.5, -0.5), (3.0, 0.9)]
"""Relative to the robot; unlike any three on the map."""
LOST = (10.0, 10.0, 3.2)
"""As docs/maps.md recommends it; wider than any heading."""
CARRIED_M = 4.0


def known(name: str) -> MapPrior | None:
    if name == "detector":
        return None
    return MapPrior(tuple(ObjectPrior.planar(n, x, y, sigma_m=0.05, sigma_rad=3.0) for n, (x, y) in enumerate(MAPPED)))


def at_rest(name: str, sigma: tuple[float, float, float]) -> tuple[Engine, HybridBelief]:
    settings = load_configuration(configuration_file(name))
    settings = replace(
        settings,
        semantic_model=replace(settings.semantic_model, kind="none"),
        initial_pose=InitialPoseConfiguration(sigma=sigma),
        revision=replace(settings.revision, carried_probability=1e-3, carried_m=CARRIED_M),
    )
    engine = Engine(settings, known(name))
    detections = [Detection.at(x, y, covariance=1e-3 * np.eye(2)) for x, y in SEEN]
    beliefs = [engine.process(Keyframe.planar(k, detections=detections, motion_sigmas=(1e-3,) * 3)) for k in range(4)]
    assert engine.carried_spans.spans == ()
    return engine, beliefs[-1]


@pytest.mark.parametrize("name", ["detector", "second_session"])
def test_what_a_lost_robot_has_seen_is_on_its_map(name: str) -> None:
    engine, belief = at_rest(name, LOST)
    assert belief.pose_covariances[0, -1, -1] > np.pi**2
    assert num_unplaced(belief, engine.run) == 0
    assert len(saved_map_of_belief(belief, engine.run).objects.ids) == len(belief.object_ids)


def test_what_it_has_seen_after_it_was_carried_is_not() -> None:
    """All of its start left open, new ground is as wide as it may have been carried, about where it was."""
    engine, belief = at_rest("detector", LOST)
    on_new_ground = CARRIED_M**2 * np.eye(2)
    poses, places = belief.pose_covariances.copy(), belief.object_covariances.copy()
    poses[:, :2, :2], poses[:, -1, -1] = on_new_ground, np.pi**2
    places[0, :2, :2] = on_new_ground
    carried = replace(belief, pose_covariances=poses, object_covariances=places)
    np.testing.assert_array_equal(mapped_rows(carried, engine.run), np.arange(1, len(SEEN)))
    places[:, :2, :2] = on_new_ground
    with pytest.raises(InputError, match="if nobody lifted it, set revision"):
        map_objects(replace(carried, object_covariances=places), engine.run)

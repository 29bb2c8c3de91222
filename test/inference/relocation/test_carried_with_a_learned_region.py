"""What is missed tells that a robot was carried once the region of its sensor is known, whether stated or learned."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.scenes.lost_world import configuration, make_world, map_of

from semantic_slam import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe

START, THERE, AFTER = np.array([4.0, -7.0, 1.9]), np.array([40.0, 3.0, 0.4]), 4
ELSEWHERE = THERE[:2] + np.array([[2.5, -1.0], [4.0, 1.5], [5.5, -0.5]])
SETTINGS = {
    "revision": {"carried_probability": 1e-3, "carried_m": 5.0},
    "initial_pose": {"mean": START.tolist(), "sigma": [0.01, 0.01, 0.01]},
}


def carried_after(count: int) -> list[Keyframe]:
    """Keyframes on the map, and then others on new ground, of which odometry tells nothing."""
    first, second = make_world(START, count).keyframes, make_world(THERE, AFTER, places=ELSEWHERE, seed=1).keyframes
    later_ns = count * (first[1].stamp_ns - first[0].stamp_ns)
    return [*first, *(replace(own, index=own.index + count, stamp_ns=own.stamp_ns + later_ns) for own in second)]


def driven(count: int, *, learned: bool) -> Engine:
    settings = configuration(**SETTINGS)
    world = replace(settings.open_world, learn_region=learned)
    engine = Engine(replace(settings, open_world=world), map_of())
    for keyframe in carried_after(count):
        engine.process(keyframe)
    return engine


@pytest.mark.long
@pytest.mark.parametrize(("count", "learned", "noticed"), [(3, False, True), (3, True, False), (8, True, True)])
def test_a_region_that_few_detections_have_shown_is_no_reason_to_take_a_robot_for_carried(
    count: int, learned: bool, noticed: bool
) -> None:
    """Nine detections, and the three after it was carried, leave most of a learned region to guesses; 24 do not."""
    engine = driven(count, learned=learned)
    assert (engine.carried > 0.9) == noticed and (engine.carried == 0.0) != noticed
    spans = engine.carried_spans.spans
    assert [last for _, last in spans] == ([count + AFTER - 1] if noticed else [])

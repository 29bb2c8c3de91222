"""Detections that err far more than others: they stay of their object, and tell little of where it is."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.drives.open_room import Room, make_room
from worlds.same_beliefs import assert_same

from semantic_slam import Detection, Engine, Keyframe
from semantic_slam.configuration import Configuration
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.pool import InProcessPool

SHARE = {"outlier_share": 0.03, "outlier_factor": 25.0}
REPEATING = {"correlated_share": 0.8, "motion_m": 1.0, "motion_rad": 1.0}
POSTS = [(2.0, -0.5), (2.5, 0.0), (2.0, 0.5)]  # range and bearing
SIGMAS = np.array([0.05, 0.02])
JUMP_M, AT = 0.3, 5  # of the second post, in this keyframe


def settings(errors: dict[str, float], association: str = "open") -> Configuration:
    region = {"min_range_m": 0.3, "max_range_m": 6.0, "field_of_view_rad": 2.0, "occluder_radius_m": 0.0}
    return Configuration.of(
        association=association,
        semantic_model={"kind": "none"},
        open_world={"iterate_updates": False, **region},
        detection_errors=errors,
    )


def beliefs(errors: dict[str, float], association: str = "open", jump_m: float = JUMP_M) -> list[HybridBelief]:
    """Of a robot that stands before three posts, one of which jumps for one keyframe."""
    engine = Engine(settings(errors, association), initial_covariance=np.diag([1e-8] * 3))
    random, found = np.random.default_rng(0), []
    for k in range(8):
        seen = np.array(POSTS) + random.normal(size=(3, 2)) * SIGMAS * [0.4, 0.4]
        if k == AT:
            seen[1, 0] += jump_m
        detections = [
            Detection(range_m=r, bearing_rad=b, covariance=np.diag(SIGMAS) ** 2, track_id=str(n))
            for n, (r, b) in enumerate(seen.tolist())
        ]
        found.append(engine.process(Keyframe.planar(k, detections=detections, motion_sigmas=(1e-3,) * 3)))
    return found


@pytest.mark.parametrize("errors", [SHARE, SHARE | REPEATING], ids=["white", "repeating"])
def test_a_box_that_jumps_once_is_an_outlier_of_its_object_and_starts_no_other(errors: dict[str, float]) -> None:
    plain, jumping = beliefs(errors, jump_m=0.0), beliefs(errors)
    assert (jumping[-1].existence > 0.1).sum() == 3
    assert jumping[AT].outlier_probability[1] > 0.95
    others = [p for k, own in enumerate(jumping) for n, p in enumerate(own.outlier_probability) if (k, n) != (AT, 1)]
    assert max(others) < 0.1
    moved = jumping[-1].object_poses[1, :2] - plain[-1].object_poses[1, :2]
    assert np.hypot(*moved) < 0.02


def test_without_outliers_nothing_is_said_of_them() -> None:
    assert all(np.isnan(own.outlier_probability).all() for own in beliefs({}, jump_m=0.0))


def test_a_name_is_right_though_its_detection_jumps() -> None:
    taken = [own.associations[0, 1] for own in beliefs(SHARE | REPEATING, "given")]
    assert len(set(taken)) == 1
    without = beliefs(REPEATING, "given")[AT]
    assert without.associations[0, 1] == -1 and without.outlier_probability[1] > 0.9


@pytest.mark.long
@pytest.mark.parametrize("errors", [SHARE, SHARE | REPEATING], ids=["white", "repeating"])
def test_a_lineage_is_rebuilt_with_its_outliers(errors: dict[str, float]) -> None:
    room = jumping_room(errors)
    whole = Engine.of_run(room.run, InProcessPool(2))
    divided = Engine.of_run(room.run, ForgetfulPool(2))
    said = []
    for keyframe in room.keyframes:
        belief = whole.process(keyframe)
        assert_same(divided.process(keyframe), belief)
        said.append(belief.outlier_probability.max(initial=0.0))
    assert max(said) > 0.5


def jumping_room(errors: dict[str, float]) -> Room:
    """A room in which the first range of every fourth keyframe is half a metre too long."""
    room = make_room(10, 0, clutter=0.05, detection_errors=errors, open_world={"iterate_updates": False})
    keyframes = list(room.keyframes)
    for k in range(3, len(keyframes), 4):
        seen = keyframes[k].measurements
        ranges = seen.ranges_m.copy()
        ranges[:1] += 0.5
        keyframes[k] = replace(keyframes[k], measurements=replace(seen, ranges_m=ranges))
    return replace(room, keyframes=keyframes)


def test_only_single_steps_without_classes_know_of_them() -> None:
    with pytest.raises(InputError, match="outlier_share"):
        make_room(1, detection_errors=SHARE)

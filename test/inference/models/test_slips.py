"""Odometry that slips now and then: a history says where it did, and is weighed with a slip and without one."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from worlds.drives.open_room import Room, make_room
from worlds.same_beliefs import assert_same

from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import (
    covariance_from_planar,
    planar_from_covariance,
    planar_from_pose_vector,
    pose_vector_from_planar,
)
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool

SLIPS = {"slip_share": 0.3, "sigma_slip_m": 0.2, "sigma_slip_rad": 0.1}
EVERYTHING = {"ratio": 1e9, "max_hypotheses": 2000}
NOT_MERGED = {"merge_position_m": 0.0, "least_existence": 1e-12}


def after(room: Room, backends: int = 1) -> Engine:
    engine = Engine.of_run(room.run, InProcessPool(backends))
    for keyframe in room.keyframes:
        engine.process(keyframe)
    return engine


def with_motion(room: Room, number: int, *, slip: Any = None, spread: Any = None) -> Room:
    """The room with one motion that is off by ``slip`` (3,), or told with the covariance ``spread`` (3, 3) besides."""
    keyframes = list(room.keyframes)
    told = keyframes[number]
    if slip is not None:
        motion = se2.compose(planar_from_pose_vector(told.odometry), np.array(slip))
        told = dataclasses.replace(told, odometry=pose_vector_from_planar(motion))
    if spread is not None:
        planar = planar_from_covariance(told.odometry_covariance)
        told = dataclasses.replace(told, odometry_covariance=covariance_from_planar(planar + spread))
    keyframes[number] = told
    return dataclasses.replace(room, keyframes=keyframes)


def slipped(belief: HybridBelief) -> float:
    return float(belief.noise_values[belief.noise_names.index("odometry.slipped")])


def test_evidence_is_the_sum_over_motions_that_slip_or_do_not() -> None:
    """Of a first motion, which everything is weighed for, and of two, of which unlikely slips are left out."""
    spread = np.diag([0.2, 0.2, 0.1]) ** 2
    for count, tolerance in ((2, 1e-6), (3, 0.05)):
        room = make_room(count, clutter=0.05, pruning=EVERYTHING, open_world=NOT_MERGED)
        alone = []
        for which in itertools.product((False, True), repeat=count - 1):
            own = room
            for number in np.flatnonzero(which) + 1:
                own = with_motion(own, int(number), spread=spread)
            alone.append(after(own).log_evidence + np.log(np.where(which, 0.3, 0.7)).sum())
        slips = make_room(count, clutter=0.05, pruning=EVERYTHING, open_world=NOT_MERGED, odometry=SLIPS)
        assert after(slips).log_evidence == pytest.approx(np.logaddexp.reduce(alone), abs=tolerance)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_slip_is_found_stated_and_taken_out_of_the_path(seed: int) -> None:
    odometry = {"slip_share": 0.01, "sigma_slip_m": 0.3, "sigma_slip_rad": 0.3}
    errors = []
    for own in (odometry, {}):
        room = with_motion(make_room(8, seed, 0.999, clutter=0.0, odometry=own), 2, slip=[0.0, 0.0, 0.4])
        engine = Engine.of_run(room.run, InProcessPool(1))
        beliefs = [engine.process(keyframe) for keyframe in room.keyframes]
        pose = planar_from_pose_vector(beliefs[-1].poses[0])
        errors.append(np.hypot(*(pose - room.truth[-1])[:2]))
        if not own:
            assert "odometry.slipped" not in beliefs[-1].noise_names
            continue
        stated = np.array([slipped(belief) for belief in beliefs])
        assert stated[2] > 0.95 and np.delete(stated, 2).max() < 0.05
        best = next(iter(engine.live.values())).lineage
        assert [k for k, step in enumerate(best) if k and step.slipped] == [2]
    assert errors[0] < 0.25 and errors[1] > 0.4


@pytest.mark.long
def test_a_history_is_rebuilt_with_its_slips() -> None:
    room = with_motion(make_room(10, clutter=0.05, odometry=SLIPS), 5, slip=[0.2, 0.1, 0.1])
    whole, divided = (Engine.of_run(room.run, pool) for pool in (InProcessPool(2), ForgetfulPool(2)))
    for keyframe in room.keyframes:
        assert_same(divided.process(keyframe), whole.process(keyframe))
    assert any(step.slipped for own in whole.live.values() for step in own.lineage[1:])


def test_slips_are_refused_where_objects_are_not_tracked() -> None:
    with pytest.raises(InputError, match="slip_share"):
        make_room(1, odometry=SLIPS, association="given")

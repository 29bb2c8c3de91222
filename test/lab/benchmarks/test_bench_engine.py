"""Chapter 4's benchmark: hybrid peers, floor and fan do what they are said to do, and exponents are those of powers."""

import numpy as np
import pytest
from semantic_slam_lab.benchmarks import engine_growth
from semantic_slam_lab.benchmarks.hybrid_smoother import LIMIT_S, STEPS, Record, run_ours, sharp_world
from semantic_slam_lab.benchmarks.keyframe_floor import Floor
from semantic_slam_lab.benchmarks.spatial_keyframe import PAIRS
from semantic_slam_lab.benchmarks.spatial_keyframe import Floor as SpatialFloor
from semantic_slam_lab.grid.hypothesis_fan import TRACKED, HypothesisFan
from semantic_slam_lab.grid.run import Setting
from semantic_slam_lab.grid.world import Noise, grid_world
from semantic_slam_lab.peers.hybrid_peers import DcsamPeer, HybridPeer, SmootherPeer

SHARP = Noise(robot=(1e-4, 1e-4, 1e-5), geometry=(0.01, 0.0009))


@pytest.mark.parametrize("peer", [SmootherPeer, DcsamPeer])
def test_hybrid_peers_are_right_where_it_is_easy(peer: type[HybridPeer]) -> None:
    world = grid_world(0, num_detections=2, num_keyframes=4, noise=SHARP)
    solver = peer(world)  # type: ignore[call-arg]
    for frame in world.frames:
        solver.update(frame)
    assert solver.associations() == [frame.objects for frame in world.frames]


def test_ours_is_right_on_geometry_alone() -> None:
    world = sharp_world(0, 2)
    associations, seconds = run_ours(world)
    record = Record()
    record.add(world, associations, seconds)
    assert record.correct == [True] and record.share == [1.0]
    record.add_failure("out of time")
    assert record.correct == [True, False] and "1 out of time" in str(record)
    assert record.seconds_per_step() == pytest.approx(np.mean(seconds))
    assert record.least_seconds_per_step() == pytest.approx(0.5 * (np.mean(seconds) + LIMIT_S / STEPS))


def test_a_fan_holds_as_many_hypotheses_as_asked() -> None:
    fan = HypothesisFan(grid_world(0, num_keyframes=3, noise=TRACKED), 1)
    fan.advance(1)
    assert len(fan) == 1
    fan.number = 7
    fan.advance(2)
    assert len(fan) == 7


def test_the_floor_estimates_the_track() -> None:
    """A clone gives the joint marginal of 7 keys and leaves the original as it was."""
    world = grid_world(2, num_keyframes=6, noise=TRACKED)
    least = Floor(world)
    for frame in world.frames[:-1]:
        least.extend(frame)
    factors = least.isam.getFactorsUnsafe().size()
    marginal = least.child(world.frames[-1])
    assert marginal.shape == (21, 21) and np.linalg.eigvalsh(marginal).min() > 0.0
    assert least.isam.getFactorsUnsafe().size() == factors
    estimate = least.isam.calculateEstimatePose2(int(least.isam.getLinearizationPoint().keys()[-1]))
    assert np.hypot(estimate.x() - world.truth[-2, 0], estimate.y() - world.truth[-2, 1]) < 0.5


@pytest.mark.parametrize("setting", [*PAIRS["points"], *PAIRS["bodies"]])
def test_fan_and_floor_are_of_one_world_in_space_too(setting: Setting) -> None:
    world = grid_world(2, num_keyframes=4, noise=TRACKED)
    fan, least = HypothesisFan(world, 1, setting), SpatialFloor(world, setting)
    fan.number = 3
    fan.advance(2)
    assert len(fan) == 3
    for _ in range(3):
        least.extend()
    robot, landmark = (6, 6 if setting.semantics else 3) if setting.is_spatial else (3, 3 if setting.semantics else 2)
    marginal = least.child()
    assert marginal.shape == (robot + 6 * landmark,) * 2 and np.linalg.eigvalsh(marginal).min() > 0.0


def test_exponents_are_those_of_powers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine_growth, "along_track", lambda seed, lengths: [2e-3 * n**1.5 for n in lengths])
    monkeypatch.setattr(engine_growth, "keyframe_seconds", lambda seed, **changed: 0.25)
    keyframes, *others = engine_growth.growth(quick=True, seed=0)
    assert keyframes.name == "keyframe_growth_keyframes" and keyframes.ratio == pytest.approx(1.5)
    assert [row.name.rsplit("_", 1)[1] for row in others] == ["objects", "detections", "hypotheses"]
    assert [row.ratio for row in others] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)

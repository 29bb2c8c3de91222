"""What the belief says of the noise of robot and sensor: the mixture of what its hypotheses take it to be."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from semantic_slam_lab.studies.drawn_worlds.study import configuration
from semantic_slam_lab.studies.drawn_worlds.worlds import drawn_world
from worlds.drives.late_odometry import late_drive
from worlds.drives.open_room import Room, make_room

from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_pose_vector, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.models.odometry_bias import slopes
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.messages.codec import from_message, to_message

ESTIMATED: dict[str, Any] = {
    "odometry": {
        "estimate_bias": True, "sigma_bias_rad_per_m": 0.05, "sigma_bias_scale": 0.1, "noise_factors": [1.0, 4.0]
    },
    "perception": {"noise_factors": [1.0, 4.0]},
    "open_world": {"iterate_updates": False, "learn_region": True, "detection_probabilities": [0.3, 0.9]},
}  # fmt: skip
BIAS = np.array([0.04, -0.06])
REGION = ["min_range_m", "max_range_m", "field_of_view_rad", "direction_rad"]


def biased_room(num_keyframes: int, **settings: Any) -> Room:
    """A room whose odometry leaves out a bias."""
    room = make_room(num_keyframes, clutter=0.05, **settings)
    step = planar_from_pose_vector(room.keyframes[0].odometry)
    odometry = pose_vector_from_planar(se2.retract(step, -slopes(step)[:, :2] @ BIAS))
    return replace(room, keyframes=[replace(keyframe, odometry=odometry) for keyframe in room.keyframes])


def last_of(room: Room, backends: int = 1) -> tuple[HybridBelief, InProcessPool]:
    pool = InProcessPool(backends)
    engine = Engine.of_run(room.run, pool)
    return [engine.process(keyframe) for keyframe in room.keyframes][-1], pool


def test_all_that_is_estimated_is_named_and_nothing_else() -> None:
    belief, _ = last_of(biased_room(3, **ESTIMATED))
    assert belief.noise_names == (
        "odometry.noise_factor",
        "perception.noise_factor",
        "open_world.detection_probability",
        "odometry.bias_rad_per_m",
        "odometry.bias_scale",
        *(f"open_world.{name}" for name in REGION),
    )
    plain, _ = last_of(make_room(3))
    assert plain.noise_names == () and plain.noise_values.shape == plain.noise_sigmas.shape == (0,)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("density", "seed"), [(0.01, 0), (0.3, 1)])
def test_how_many_objects_there_are_is_decided_by_evidence(density: float, seed: int) -> None:
    """Along drives through worlds that are sparse or crowded; in the sparse one nothing is detected at all."""
    base = configuration()
    world = replace(base.open_world, learn_region=False, detection_probabilities=(0.9,), birth_densities=(0.01, 0.3))
    stated = replace(base, open_world=world)
    drawn = replace(base, open_world=replace(world, birth_densities=(density,)))
    engine = Engine(stated)
    for keyframe in drawn_world(drawn, 6, np.random.default_rng(seed)).keyframes:
        belief = engine.process(keyframe)
    found = belief.noise_values[belief.noise_names.index("open_world.birth_density")]
    assert found == pytest.approx(density, abs=0.03)


def test_what_hypotheses_differ_in_is_weighed_with_them() -> None:
    belief, pool = last_of(
        biased_room(6, perception={"noise_factors": [1.0, 4.0]}, open_world={"iterate_updates": False})
    )
    factors = [pool._backends[0].held[int(n)].component.noise_settings.detection_factor for n in belief.hypothesis_ids]
    share = np.exp(belief.log_weights)[np.array(factors) == 4.0].sum()
    assert 0.001 < share < 0.999
    assert belief.noise_values == pytest.approx([1.0 + 3.0 * share])
    assert belief.noise_sigmas == pytest.approx([3.0 * np.sqrt(share * (1.0 - share))])


def test_the_spread_of_a_bias_is_that_within_hypotheses_and_between_them() -> None:
    belief, pool = last_of(biased_room(20, odometry=ESTIMATED["odometry"], open_world={"iterate_updates": False}))
    tracked = [pool._backends[0].held[int(n)].component.tracked for n in belief.hypothesis_ids]
    weights, prior = np.exp(belief.log_weights), np.array([0.05, 0.1])
    means = np.array([own.bias[:2] for own in tracked]) * prior
    within = np.array([np.diag(own.propagated_covariance)[3:5] for own in tracked]) * prior**2
    squares = weights @ (within + means**2)
    np.testing.assert_allclose(belief.noise_values[1:], weights @ means, atol=1e-12)
    np.testing.assert_allclose(belief.noise_sigmas[1:], np.sqrt(squares - (weights @ means) ** 2), atol=1e-9)
    assert (np.abs(belief.noise_values[1:] - BIAS) < 3.0 * belief.noise_sigmas[1:]).all()
    assert (belief.noise_sigmas[1:] < 0.9 * prior).all()


def test_a_learned_region_is_told_without_a_spread() -> None:
    belief, _ = last_of(make_room(10, open_world={"learn_region": True}))
    assert belief.noise_names == tuple(f"open_world.{name}" for name in REGION)
    assert np.isnan(belief.noise_sigmas).all()
    nearest, farthest, width, direction = belief.noise_values
    assert 0.0 < nearest < farthest < 6.0 and 0.5 <= width < 2.0 and abs(direction) < 0.5
    np.testing.assert_array_equal(from_message(to_message(belief)).noise_sigmas, belief.noise_sigmas)


def test_the_inferred_noise_is_the_same_however_the_work_is_divided() -> None:
    room = biased_room(8, **ESTIMATED)
    one, three = (last_of(room, backends)[0] for backends in (1, 3))
    np.testing.assert_array_equal(three.noise_values, one.noise_values)
    np.testing.assert_array_equal(three.noise_sigmas, one.noise_sigmas)


def test_a_clock_is_named_where_its_offset_is_estimated() -> None:
    for sigma_s, names in ((0.2, {"odometry.clock_offset_s"}), (0.0, set())):
        drive = late_drive(0.1, sigma_s, duration_s=3.0, expected_s=0.1)
        engine = Engine.of_run(drive.run, InProcessPool(1))
        belief = [engine.process(keyframe) for keyframe in drive.keyframes][-1]
        assert set(belief.noise_names) == {"odometry.bias_rad_per_m", "odometry.bias_scale"} | names
        if names:
            assert belief.noise_values[-1] == pytest.approx(0.1, abs=3.0 * belief.noise_sigmas[-1])
            assert 0.0 < belief.noise_sigmas[-1] < 0.2


def test_what_is_expected_of_a_bias_is_part_of_what_is_told() -> None:
    expected = {**ESTIMATED["odometry"], "bias_rad_per_m": 0.04, "bias_scale": -0.06, "noise_factors": [1.0]}
    told, _ = last_of(biased_room(20, odometry=expected, open_world={"iterate_updates": False}))
    assert (np.abs(told.noise_values - BIAS) < 3.0 * told.noise_sigmas).all()
    first, _ = last_of(biased_room(1, odometry=expected, open_world={"iterate_updates": False}))
    np.testing.assert_allclose(first.noise_values, BIAS, atol=0.02)

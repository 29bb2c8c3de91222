"""Where odometry is missing for longer than its rate allows, a keyframe says how little it knows of its motion."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import PERIOD, START, odometry

from semantic_slam.configuration import from_dict
from semantic_slam.geometry.transform import compose
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import NANOSECONDS, OdometryEstimate
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler

STEP_NS = NANOSECONDS // 10
PACE_M_S = 0.5
SPREAD = (0, 1)


def seen(stamp_ns: int) -> SemanticMeasurements:
    """One detection."""
    return SemanticMeasurements(
        stamp_ns=stamp_ns, sequence=0, frame_id="base_link", class_names=("a",),
        detection_ids=np.zeros(1, np.uint32), boxes=np.zeros((1, 4)), labels=("x",), scores=np.ones(1),
        track_ids=("",), class_probability_samples=np.ones((1, 2, 1)), features=np.ones((1, 1)),
        feature_covariances=np.ones((1, 1, 1)), predictive_entropy=np.zeros(1), mutual_information=np.zeros(1),
        ranges_m=np.ones(1), bearings_rad=np.zeros(1), geometric_covariances=np.eye(2)[None],
        sensor_position=np.zeros(3), in_coverage=np.ones(1, bool),
    )  # fmt: skip


def samples(*missing: range) -> list[OdometryEstimate]:
    """Four seconds of steady driving along x, but for those steps that are missing."""
    gone = {step for steps in missing for step in steps}
    return [odometry(START + k * STEP_NS, PACE_M_S * k / 10) for k in range(41) if k not in gone]


def keyframes(odometries: list[OdometryEstimate], *steps: float) -> list[Keyframe]:
    """The keyframes of detections at those steps, which are multiples of the odometry's."""
    return assembled(KeyframeAssembler(from_dict({})), odometries, *steps)


def assembled(assembler: KeyframeAssembler, odometries: list[OdometryEstimate], *steps: float) -> list[Keyframe]:
    for item in odometries:
        assembler.add_odometry(to_message(item))
    for step in steps:
        assembler.add_measurements(seen(START + round(step * STEP_NS)))
    return assembler.flush()


def sigma(keyframe: Keyframe, axis: int) -> float:
    return float(np.sqrt(keyframe.odometry_covariance[axis, axis]))


def test_between_samples_at_their_rate_nothing_is_added() -> None:
    plain = keyframes(samples(), 10.5, 20.5)
    lost_one = keyframes(samples(range(15, 16), range(20, 21)), 10.5, 20.5)
    for a, b in zip(plain, lost_one, strict=True):
        np.testing.assert_allclose(a.odometry_covariance, b.odometry_covariance, rtol=1e-9)


@pytest.mark.parametrize(("step", "share_s"), [(15.0, 0.5), (20.0, 1.0), (25.0, 0.5)])
def test_within_a_gap_the_robot_may_have_stood_or_gone_at_its_pace(step: float, share_s: float) -> None:
    gap = range(11, 30)  # 2 s between samples 10 and 30
    (keyframe,) = keyframes(samples(gap), step)
    (plain,) = keyframes(samples(), step)
    np.testing.assert_allclose(keyframe.odometry, plain.odometry, atol=1e-9)  # steady motion is the best guess
    added = keyframe.odometry_covariance - plain.odometry_covariance
    assert np.sqrt(added[0, 0]) == pytest.approx(PACE_M_S * share_s, rel=1e-3)
    assert np.sqrt(added[1, 1]) == pytest.approx(PACE_M_S * share_s, rel=1e-3)


def test_after_a_gap_the_odometry_is_as_sure_as_ever_and_the_keyframe_within_it_is_not() -> None:
    gap = range(11, 30)
    into, out = keyframes(samples(gap), 20.0, 35.0)
    (across,) = keyframes(samples(gap), 35.0)
    (plain,) = keyframes(samples(), 35.0)
    assert sigma(into, 0) > 0.4 and sigma(out, 0) > 0.4
    np.testing.assert_allclose(across.odometry_covariance, plain.odometry_covariance, rtol=1e-9)


def test_a_gap_of_seconds_is_told_once_and_many_of_them_not_for_ever() -> None:
    assembler = KeyframeAssembler(from_dict({}))
    assembled(assembler, samples(range(11, 25)), 15.0)
    assert assembler.news() == []
    assembler = KeyframeAssembler(from_dict({}))
    assembled(assembler, samples(range(11, 31)), 15.0)
    (line,) = assembler.news()
    assert line.startswith(
        f"odom is missing for 2.1 s from {START / NANOSECONDS + 1.0:.1f} s on; where keyframes lie in"
    )
    assert assembler.news() == []
    often = [odometry(START + (k + 30 * (k // 10)) * STEP_NS, PACE_M_S * k / 10) for k in range(100)]
    assembler = KeyframeAssembler(from_dict({}))
    assembled(assembler, often, 15.0)
    *_, last = told = assembler.news()
    assert len(told) == 5 and last.endswith("further gaps are not told")


def test_a_turn_that_nobody_saw_is_not_taken_for_steady() -> None:
    before = samples(range(11, 41))
    turned = replace(odometry(START + 30 * STEP_NS, 1.5), pose=np.array([1.5, 0, 0, 0, 0, np.sin(0.5), np.cos(0.5)]))
    (keyframe,) = keyframes([*before, turned], 20.0)
    assert sigma(keyframe, 5) > 0.5  # half of the turn of 1 rad may have been over, or all of it, or none
    assert np.isfinite(keyframe.odometry_covariance).all()


def test_after_the_last_odometry_the_robot_may_have_moved_on() -> None:
    early, late = (keyframes(samples(), 40.0 + steps)[0] for steps in (1.0, 9.0))
    assert sigma(early, 0) < sigma(late, 0)
    assert sigma(late, 0) >= PACE_M_S * 0.9


def jumping(odometries: list[OdometryEstimate], step: int, T_new_old: np.ndarray) -> list[OdometryEstimate]:
    """From a step on, odometry of another origin."""
    after = [replace(item, pose=compose(T_new_old, item.pose)) for item in odometries[step:]]
    return [*odometries[:step], *after]


FAR = np.array([8.0, -6.0, 0.0, 0.0, 0.0, np.sin(0.5), np.cos(0.5)])
JUMPS = "odom: jumps farther than any robot moves"


def test_odometry_that_jumps_is_missing_for_that_step() -> None:
    assembler = KeyframeAssembler(from_dict({}))
    before, across, after = assembled(assembler, jumping(samples(), 20, FAR), 10.0, 30.0, 40.0)
    plain = keyframes(samples(), 10.0, 30.0, 40.0)
    assert assembler.dropped == {JUMPS: 1}
    np.testing.assert_allclose(before.odometry, plain[0].odometry, atol=1e-9)
    np.testing.assert_allclose(across.odometry, [PACE_M_S * 1.9, 0, 0, 0, 0, 0, 1], atol=1e-9)  # it may have stood
    np.testing.assert_allclose(after.odometry, plain[2].odometry, atol=1e-9)
    added = across.odometry_covariance - plain[1].odometry_covariance
    assert np.sqrt(added[0, 0]) == pytest.approx(PACE_M_S * 0.1, rel=0.1)  # or have gone on
    np.testing.assert_allclose(after.odometry_covariance, plain[2].odometry_covariance, rtol=1e-6)


def test_one_sample_that_is_far_off_does_not_move_the_robot() -> None:
    assembler = KeyframeAssembler(from_dict({}))
    far = jumping(samples(), 20, FAR)[20]
    (keyframe,) = assembled(assembler, [*samples()[:20], far, *samples()[21:]], 40.0)
    assert assembler.dropped == {JUMPS: 2}
    np.testing.assert_allclose(keyframe.odometry, [PACE_M_S * 3.8, 0, 0, 0, 0, 0, 1], atol=1e-9)
    assert sigma(keyframe, 0) > PACE_M_S * 0.2


def test_a_turn_faster_than_any_robot_turns_is_a_jump() -> None:
    fast = [odometry(START + k * STEP_NS // 10, 0.0) for k in range(41)]
    half_turn = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    assembler = KeyframeAssembler(from_dict({}))
    (keyframe,) = assembled(assembler, jumping(fast, 20, half_turn), 4.0)
    assert assembler.dropped == {JUMPS: 1}
    np.testing.assert_allclose(keyframe.odometry, [0, 0, 0, 0, 0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("speed_m_s", [25.0, 45.0])
def test_stamps_that_are_coarse_or_come_in_bursts_are_no_jumps(speed_m_s: float) -> None:
    fast = [odometry(START + k * STEP_NS, speed_m_s * k / 10) for k in range(41)]
    burst = [*fast[:20], *(replace(fast[k], stamp_ns=START + 20 * STEP_NS + k) for k in range(20, 25)), *fast[25:]]
    assembler = KeyframeAssembler(from_dict({}))
    (keyframe,) = assembled(assembler, burst, 40.0)
    assert not assembler.dropped
    assert keyframe.odometry[0] == pytest.approx(speed_m_s * 4.0)


def test_what_a_robot_at_rest_may_have_done_meanwhile_is_told_by_where_it_is_afterwards() -> None:
    still = [odometry(START + k * STEP_NS, 0.0) for k in range(11)]
    moved = odometry(START + 30 * STEP_NS, 2.0)
    (keyframe,) = keyframes([*still, moved], 20.0)
    assert sigma(keyframe, 0) == pytest.approx(1.0, rel=0.05)  # 2 m in 2 s: anywhere between the ends


def test_sparse_odometry_has_no_gaps_of_its_own() -> None:
    sparse = [odometry(START + k * 5 * PERIOD, 0.3 * k) for k in range(9)]
    assembler = KeyframeAssembler(from_dict({}))
    for item in sparse:
        assembler.add_odometry(to_message(item))
    assembler.add_measurements(seen(START + 32 * PERIOD))
    (keyframe,) = assembler.flush()
    travelled = 0.3 * 6.4
    assert sigma(keyframe, 0) < 0.01 + from_dict({}).odometry.sigma_translation_per_m * travelled + 1e-6


@pytest.mark.parametrize("wrong", [(100,), (100, 200), (0, 300)])
def test_the_first_stamps_of_odometry_leave_nothing_behind_where_they_were_wrong(wrong: tuple[int, ...]) -> None:
    """Its first two may be wrong; no motion, rate or start is taken from those that are withdrawn."""
    right = samples()[1:]
    ahead = [odometry(START + step * STEP_NS, 7.0) for step in wrong if step] + right
    if 0 in wrong:
        ahead, right = [*samples()[:1], *ahead], samples()
    with_wrong, without = keyframes(ahead, 10.5, 20.5), keyframes(right, 10.5, 20.5)
    for a, b in zip(with_wrong, without, strict=True):
        np.testing.assert_array_equal(a.odometry, b.odometry)
        np.testing.assert_array_equal(a.odometry_covariance, b.odometry_covariance)

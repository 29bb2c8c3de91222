"""Topic imu tells which way is up at keyframes, however the robot moves, or says why it does not."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import static_transform

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.inputs.keyframe import Keyframe, OdometrySample
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.inertial import imu_message
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.standard import NANOSECONDS, OdometryEstimate, PoseEstimate
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.gravity.gravity_by_imu import GravityByImu, ImuSource
from semantic_slam.pipeline.gravity.imu_use import left_out, unused_because
from semantic_slam.pipeline.odometry.motion import start
from semantic_slam.pipeline.odometry.odometry_path import OdometryPath
from semantic_slam.pipeline.start import start_of

SPACE = {"state_space": "spatial", "association": "open", "observation": "points", "semantic_model": {"kind": "none"}}
T_BODY_IMU = np.append([0.3, 0.1, -0.2], so3.exp(np.array([1.0, -0.5, 2.0])))
GRAVITY = np.array([0.0, 0.0, 9.81])
SIGMA = 0.02
Motion = Callable[[np.ndarray], np.ndarray]
"""(N,) seconds -> (N, 7) poses in odom."""


def tree(frame: str = "imu_link") -> TransformTree:
    found = TransformTree()
    found.add(static_transform(0, frame, T_BODY_IMU))
    return found


def settings(**imu: object) -> Configuration:
    return Configuration.of(
        **SPACE,
        imu={"sigma_level_rad": SIGMA, **imu},
        odometry={"level_repeats_s": 0.0},
        initial_pose={"mean": [1, 2, 3, 0, 0, 0.7], "sigma": [0.1] * 6},
    )


def at(time_s: float) -> int:
    """Stamp [ns] of a time [s]."""
    return round(time_s * NANOSECONDS) + 10 * NANOSECONDS


def shown_messages(motion: Motion, times: np.ndarray, scale: float = 1.0, frame: str = "imu_link") -> list[Any]:
    """What an accelerometer without errors shows."""
    before, now, after = (se3.compose(motion(times + step), T_BODY_IMU) for step in (-1e-3, 0.0, 1e-3))
    own = (before[:, :3] - 2.0 * now[:, :3] + after[:, :3]) / 1e-6
    shown = scale * so3.rotated(so3.inverse(now[:, 3:]), own + GRAVITY)
    return [imu_message(at(time_s), frame, told) for time_s, told in zip(times, shown, strict=True)]


class Body:
    """One that moves, its odometry at 20 Hz and its sensor at 100 Hz, 2 s before its first keyframe until its last."""

    def __init__(self, motion: Motion, configuration: Configuration | None = None, *, waits: bool = True) -> None:
        self.motion, self.dropped = motion, Counter[str]()
        self.gravity = GravityByImu(configuration or settings(), ImuSource(tree(), waits), self.dropped)

    def listen(self, until_s: float, since_s: float = -2.0, scale: float = 1.0, frame: str = "imu_link") -> None:
        times = np.arange(since_s, until_s + 1e-9, 0.01)
        for message in shown_messages(self.motion, times, scale, frame):
            self.gravity.add(message)

    def look(self, time_s: float) -> np.ndarray | None:
        times = np.arange(-2.0, time_s + 1e-9, 0.05)
        points = [start(OdometrySample(at(own), pose)) for own, pose in zip(times, self.motion(times), strict=True)]
        return self.gravity.level_at(at(time_s), OdometryPath.of(points))

    def up(self, time_s: float) -> np.ndarray:
        return so3.matrix(self.motion(np.array([time_s]))[0, 3:])[2]


def carried(acceleration: float = 0.0, turn_rad_s: float = 0.0) -> Motion:
    """Tilted, along a line of a constant acceleration, turning about the vertical."""

    def motion(times: np.ndarray) -> np.ndarray:
        turns = np.zeros((len(times), 3))
        turns[:, 2] = turn_rad_s * times
        tilt = so3.exp(np.array([0.3, -0.2, 0.0]))
        ahead = 0.5 * acceleration * times**2
        return np.column_stack([ahead, 0.2 * times, 0.0 * times, so3.product(so3.exp(turns), tilt)])

    return motion


@pytest.mark.parametrize("motion", [carried(), carried(acceleration=0.4), carried(turn_rad_s=1.0)])
def test_up_is_told_whatever_the_robots_own_acceleration(motion: Motion) -> None:
    """0.4 m/s^2 would tilt a mean of accelerations by 0.04 rad, and a turn with the sensor off its axis by 0.03."""
    body = Body(motion)
    body.listen(1.0)
    for time_s in (0.0, 0.5, 1.0):
        found = body.look(time_s)
        assert found is not None
        np.testing.assert_allclose(found, np.append(body.up(time_s), SIGMA**2), atol=1e-3)
    assert body.dropped == {}


def test_an_orientation_counts_before_accelerations_and_as_sure_as_it_states() -> None:
    body = Body(carried(turn_rad_s=0.5))
    for time_s in (-0.02, -0.01):
        turn = se3.compose(body.motion(np.array([time_s])), T_BODY_IMU)[0, 3:]
        message = imu_message(at(time_s), "imu_link", np.zeros(3), turn, 0.003**2)
        body.gravity.add(message)
    np.testing.assert_allclose(body.look(0.0), np.append(body.up(0.0), 0.003**2), atol=1e-9)


def with_orientations(
    body: Body, until_s: float, turn: np.ndarray | None = None, variance: float = 0.01, scale: float = 1.0
) -> None:
    """Listen to messages with orientations: true ones, or a ``turn`` that never changes."""
    times = np.arange(-2.0, until_s + 1e-9, 0.01)
    turns = se3.compose(body.motion(times), T_BODY_IMU)[:, 3:] if turn is None else np.tile(turn, (len(times), 1))
    for message, told in zip(shown_messages(body.motion, times, scale), turns, strict=True):
        x, y, z, w = told.tolist()
        message.orientation.x, message.orientation.y, message.orientation.z, message.orientation.w = x, y, z, w
        message.orientation_covariance = (variance * np.eye(3)).ravel()
        body.gravity.add(message)


IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def test_by_a_covariance_that_means_unknown_accelerations_count() -> None:
    body = Body(carried(turn_rad_s=0.5))
    with_orientations(body, 1.0, IDENTITY, variance=1e6)
    for time_s in (0.0, 0.5, 1.0):
        np.testing.assert_allclose(body.look(time_s), np.append(body.up(time_s), SIGMA**2), atol=1e-3)
    assert body.dropped == {} and body.gravity.news() == []


def test_orientations_that_contradict_accelerations_do_not_count_and_are_told_once() -> None:
    """Of a driver that states an orientation which it does not measure; the first keyframe shows it."""
    body = Body(carried(acceleration=0.4))
    with_orientations(body, 2.0, IDENTITY)
    told = []
    for time_s in (0.0, 0.5, 1.0, 1.5, 2.0):
        np.testing.assert_allclose(body.look(time_s), np.append(body.up(time_s), SIGMA**2), atol=1e-3)
        told.append(body.gravity.news())
    shown = se3.compose(body.motion(np.array([0.0])), T_BODY_IMU)[0, 3:]
    off = np.degrees(np.arccos(so3.matrix(shown)[2, 2]))
    assert [len(lines) for lines in told] == [1, 0, 0, 0, 0]
    assert told[0][0].startswith(f"imu: up by its orientation is {off:.0f} deg off up by its accelerations, and these")
    assert "-1 as first entry of orientation_covariance" in told[0][0]
    assert body.gravity.faults == told[0]
    assert body.dropped == {"imu: orientation that contradicts accelerations, or did, so that these count": 5}
    message = imu_message(at(2.5), "imu_link", np.zeros(3), IDENTITY, 0.01)
    body.gravity.add(message)
    assert body.look(2.5) is None  # accelerations leave a gap, and orientations are not believed any more


def test_an_orientation_that_contradicted_waits_until_accelerations_confirm_it() -> None:
    """Where these tell nothing, as the robot accelerates, neither counts; before a contradiction orientations do."""
    body = Body(lambda times: carried(acceleration=4.0)(np.maximum(times - 0.5, 0.0)))
    with_orientations(body, 2.0, IDENTITY)
    assert body.look(0.0) is not None and body.look(1.5) is None
    right = Body(lambda times: carried(acceleration=4.0)(np.maximum(times - 0.5, 0.0)))
    with_orientations(right, 2.0)
    assert right.look(0.0) is not None and right.look(1.5) is not None


def test_of_orientations_and_contradicting_accelerations_that_are_upside_down_neither_counts() -> None:
    """A driver may show accelerations with the wrong sign and right orientations, or a body be upside down."""
    body = Body(carried())
    with_orientations(body, 1.0, scale=-1.0)
    assert body.look(0.0) is None and body.look(0.5) is None
    assert body.dropped == {"imu: orientation contradicts accelerations, which are upside down": 2}
    contradicted, opened = sorted(body.gravity.news(), reverse=True)
    assert "180 deg off up by its accelerations, and neither counts" in contradicted
    assert opened.startswith("imu tells nothing at the first keyframe (orientation contradicts accelerations, which")


@pytest.mark.parametrize(
    ("frame", "scale", "axis"), [("imu_link", -1.0, "-z of the body, 159 deg"), ("base_link", 1.0, "of the body, ")]
)
def test_accelerations_upside_down_or_of_another_frame_are_told_once(frame: str, scale: float, axis: str) -> None:
    """With the line of the doctor; nothing in the run itself contradicts them."""
    body = Body(carried())
    body.listen(1.0, scale=scale, frame=frame)
    found = [body.look(time_s) is not None for time_s in (0.0, 0.5, 1.0)]
    (line,) = body.gravity.news()
    assert found == [True] * 3 and line.startswith("imu: up is along ") and axis in line
    assert "give its pose in the body by /tf_static or imu.extrinsics" in line and body.gravity.faults == [line]


def test_orientations_that_state_to_be_rough_contradict_nothing() -> None:
    body = Body(carried(acceleration=0.4))
    with_orientations(body, 3.0, IDENTITY, variance=1.0)
    for time_s in np.arange(0.0, 3.1, 0.5):
        assert body.look(time_s) is not None
    assert body.gravity.news() == []


@pytest.mark.parametrize("motion", [carried(turn_rad_s=1.0), carried(acceleration=4.0)])
def test_orientations_that_are_right_contradict_nothing_and_motion_is_no_contradiction(motion: Motion) -> None:
    body = Body(motion)
    with_orientations(body, 3.0)
    for time_s in np.arange(0.0, 3.1, 0.5):
        assert body.look(time_s) is not None
    assert body.gravity.news() == []


def test_a_start_in_motion_is_told_roughly_and_later_looks_like_it_are_left_out() -> None:
    body = Body(carried(acceleration=1.5))
    body.listen(0.5)
    first = body.look(0.0)
    assert first is not None and np.sqrt(first[3]) == pytest.approx(np.hypot(SIGMA, 1.5 / 9.81), rel=1e-3)
    assert np.arccos(first[:3] @ body.up(0.0)) < np.sqrt(first[3])
    assert body.look(0.5) is None
    reason = "imu: keyframe while the robot accelerates by more than imu.most_acceleration_m_s2"
    assert body.dropped == {reason: 1}


def test_a_start_without_odometry_before_it_is_told_roughly() -> None:
    body = Body(carried())
    body.listen(0.0, since_s=-0.1)
    first = body.look(0.0)
    assert first is not None and np.sqrt(first[3]) == pytest.approx(np.hypot(SIGMA, 1.0 / 9.81), rel=0.01)


def test_what_tells_nothing_is_left_out_with_its_reason() -> None:
    later = Body(carried())
    later.listen(0.0)
    later.look(0.0)
    later.listen(1.05, since_s=1.0)
    assert later.look(1.05) is None
    assert later.look(9.0) is None
    assert later.dropped == {
        "imu: messages or odometry do not cover imu.window_s before a keyframe": 1,
        "imu: no message within imu.window_s before a keyframe": 1,
    }
    in_units_of_g, strange = Body(carried()), Body(carried())
    in_units_of_g.listen(0.0, scale=1.0 / 9.81)
    strange.listen(0.5, frame="lidar")
    assert in_units_of_g.look(0.0) is None and strange.look(0.0) is None and strange.look(0.5) is None
    assert in_units_of_g.dropped == {"imu: accelerations that do not come to gravity, 9.81 m/s^2": 1}
    assert strange.dropped == {
        "imu: no static transforms from base_link to 'lidar', publish /tf_static or set imu.extrinsics": 2,
    }


def test_looks_within_the_time_in_which_errors_repeat_count_as_one() -> None:
    own = Configuration.of(**SPACE, imu={"sigma_level_rad": SIGMA}, odometry={"level_repeats_s": 1.0})
    body = Body(carried(), own)
    body.listen(2.0)
    looks = [body.look(0.25 * n) for n in range(9)]
    assert sum(1.0 / look[3] for look in looks[1:] if look is not None) == pytest.approx(2.0 / SIGMA**2)


def test_messages_are_waited_for_and_live_one_that_is_silent_is_not() -> None:
    patient, live = Body(carried()), Body(carried(), waits=False)
    now, later = at(0.0), at(6.0)
    for body in (patient, live):
        body.listen(-0.5)
        assert not body.gravity.is_known(now, now)
    assert not patient.gravity.is_known(now, later) and patient.gravity.is_silent(later)
    assert live.gravity.is_known(now, later)
    patient.listen(0.0, since_s=-0.49)
    assert patient.gravity.is_known(now, now)


def behind(imu: ImuSource, late_s: float = 0.0) -> list[Keyframe]:
    """Keyframes of a node that is behind and takes topics in turn; the sensor's clock is ``late_s`` late.

    Odometry at 20 Hz is then seconds ahead of the sensor at 100 Hz, all of whose messages come.
    """
    motion, since = carried(turn_rad_s=0.2), 100.0
    times = np.arange(0.0, 14.0, 0.05)
    odometry = [
        to_message(OdometryEstimate(at(since + time_s), "odom", "base_link", pose, np.zeros((6, 6))))
        for time_s, pose in zip(times, motion(times), strict=True)
    ]
    readings = shown_messages(lambda now: motion(now - since), np.arange(since, since + 13.0, 0.01))
    for message in readings:
        message.header.stamp.sec -= round(late_s)
    frames = [Keyframe.spatial(0, stamp_ns=at(since + second)).measurements for second in range(2, 12)]
    assembler = KeyframeAssembler(settings(), imu=imu)
    found = []
    for turn, reading in enumerate(readings):
        if turn < len(odometry):
            assembler.add_odometry(odometry[turn])
        if turn < len(frames):
            assembler.add_measurements(frames[turn])
        assembler.add_imu(reading)
        found += assembler.take()
    return found


def test_live_messages_that_queue_are_waited_for_as_offline() -> None:
    live, offline = (behind(ImuSource(tree(), waits=waits)) for waits in (False, True))
    assert len(live) == len(offline) == 10
    for one, other in zip(live, offline, strict=True):
        assert one.level is not None
        np.testing.assert_array_equal(one.level, other.level)


@pytest.mark.parametrize("late_s", [60.0, 15.0])
def test_live_a_sensor_whose_clock_is_late_is_not_waited_for(late_s: float) -> None:
    """Else each belief would be late by that much."""
    live = behind(ImuSource(tree(), waits=False), late_s=late_s)
    assert [keyframe.level for keyframe in live] == [None] * 10


def told_messages(motion: Motion) -> list[list[Any]]:
    """Odometry, topic imu and frames without a detection of three seconds; the sensor's clock steps back once."""
    times = np.arange(-1.5, 1.5, 0.05)
    odometry = [
        OdometryEstimate(at(time_s), "odom", "base_link", pose, np.zeros((6, 6)))
        for time_s, pose in zip(times, motion(times), strict=True)
    ]
    readings = shown_messages(motion, np.arange(-1.5, 1.5, 0.01))
    readings.insert(100, imu_message(at(-1.4), "imu_link", GRAVITY))
    frames = [Keyframe.spatial(0, stamp_ns=at(time_s)).measurements for time_s in (0.0, 0.5, 1.0)]
    return [list(map(to_message, odometry)), readings, frames]


def assembled(arrival: list[tuple[int, Any]]) -> tuple[list[Keyframe], Counter[str]]:
    found, dropped, _ = assembled_by(KeyframeAssembler(settings(), imu=ImuSource(tree())), arrival)
    return found, dropped


def assembled_by(
    assembler: KeyframeAssembler, arrival: list[tuple[int, Any]]
) -> tuple[list[Keyframe], Counter[str], list[str]]:
    """Keyframes, what was dropped, and lines of the console."""
    adders = (assembler.add_odometry, assembler.add_imu, assembler.add_measurements)
    keyframes = []
    for stream, item in arrival:
        adders[stream](item)
        keyframes += assembler.take()
    return [*keyframes, *assembler.flush()], assembler.dropped, assembler.news()


@pytest.mark.parametrize("seed", range(3))
def test_keyframes_do_not_depend_on_the_order_of_arrival(seed: int) -> None:
    streams = told_messages(carried(acceleration=0.3, turn_rad_s=0.5))
    expected, _ = assembled([(n, item) for n, stream in enumerate(streams) for item in stream])
    order = np.random.default_rng(seed).permutation(np.repeat(np.arange(3), [len(stream) for stream in streams]))
    rest = [iter(stream) for stream in streams]
    found, dropped = assembled([(n, next(rest[n])) for n in order.tolist()])
    assert dropped == {"imu: time goes backwards": 1}
    assert len(found) == len(expected) == 3
    for one, other in zip(found, expected, strict=True):
        assert one.level is not None
        np.testing.assert_array_equal(one.level, other.level)


def test_a_run_does_not_begin_just_before_its_sensor_is_heard() -> None:
    """Nor, live, before the transform to its frame has come; but it does not wait for long."""
    motion = carried()
    odometry, readings, frames = told_messages(motion)
    late = odometry, readings[-80:], frames
    found, dropped = assembled([(n, item) for n, stream in enumerate(late) for item in stream])
    assert [keyframe.stamp_ns for keyframe in found] == [at(1.0)] and found[0].level is not None
    assert dropped["/classifier/measurements: just before imu is heard, with which the run begins"] == 2
    never, _ = assembled([(n, item) for n, stream in enumerate((odometry, [], frames)) for item in stream])
    assert len(never) == 3 and never[0].level is None
    live = Body(motion, waits=False)
    live.listen(6.0, frame="lidar")
    assert live.gravity.begins_later(at(0.0)) and live.gravity.begins_later(at(5.0))
    assert not live.gravity.begins_later(at(5.5))


@pytest.mark.parametrize("scale", [0.0, 1.4])
def test_a_run_whose_sensor_tells_nothing_at_first_begins_with_its_tilt_open(
    scale: float,
) -> None:
    """As of one that warms up, or is jolted; without a sensor the tilt is known as configured."""
    motion = carried(turn_rad_s=0.5)
    odometry, _, frames = told_messages(motion)
    bad, good = np.arange(-1.5, 0.2, 0.01), np.arange(0.2, 1.5, 0.01)
    readings = shown_messages(motion, bad, scale) + shown_messages(motion, good)
    arrival = [(n, item) for n, stream in enumerate((odometry, readings, frames)) for item in stream]
    found, _, told = assembled_by(KeyframeAssembler(settings(), imu=ImuSource(tree())), arrival)
    assert found[0].level is None and found[-1].level is not None
    np.testing.assert_allclose(found[-1].level[:3], so3.matrix(motion(np.array([1.0]))[0, 3:])[2], atol=0.02)
    pose, covariance = start_of(settings(), None, found[0])
    np.testing.assert_allclose(np.diagonal(covariance), [0.01, 0.01, 0.01, 0.25, 0.25, 0.01])
    assert len(told) == 1 and told[0].startswith("imu tells nothing at the first keyframe (")
    without, _, said = assembled_by(KeyframeAssembler(settings()), [item for item in arrival if item[0] != 1])
    same_pose, known = start_of(settings(), None, without[0])
    np.testing.assert_array_equal(pose, same_pose)
    np.testing.assert_allclose(np.diagonal(known), [0.01] * 6)
    by_hand = PoseEstimate(0, "map", pose, 1e-4 * np.eye(6))
    assert start_of(settings(), by_hand, found[0])[1] is by_hand.covariance and said == []


def test_extrinsics_that_are_none_are_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"imu\.extrinsics: its quaternion is zero; give qx qy qz qw"):
        Body(carried(), settings(extrinsics=[0.0] * 7))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"state_space": "planar", "observation": "range_bearing"}, "a planar robot is level"),
        ({"odometry": {"sigma_level_rad": 0.01}}, "by odometry.sigma_level_rad odometry tells roll and pitch"),
        ({"imu": {"sigma_level_rad": 0.0}}, "imu.sigma_level_rad is 0"),
    ],
)
def test_where_it_is_not_used_one_line_says_why(changes: dict[str, object], reason: str) -> None:
    own = Configuration.of(**{**SPACE, **changes})
    assert unused_because(own) == reason and unused_because(Configuration.of(**SPACE)) == ""
    assert left_out(own, {"/imu": topics.TYPES[topics.IMU]}) == f"/imu is not used: {reason}"
    assert left_out(own, {}) == ""


def test_an_imu_topic_of_another_type_is_named_where_it_would_be_used() -> None:
    told = left_out(Configuration.of(**SPACE), {"/imu": "my_msgs/msg/Imu"})
    assert told.startswith("/imu is my_msgs/msg/Imu, not sensor_msgs/msg/Imu, and is not used; import_dataset bag")


def test_a_run_begins_as_tilted_as_its_first_look_has_it() -> None:
    """At the place and heading that the configuration says; before the look nothing is known of the tilt.

    Of a look that tells less than that the configuration's tilt stays.
    """
    motion = np.append([0.1, 0.0, 0.0], so3.exp(np.array([0.0, 0.1, 0.0])))
    true = np.append([1.0, 2.0, 3.0], so3.product(so3.exp(np.array([0.0, 0.0, 0.7])), so3.exp(np.array([0.4, 0, 0]))))
    up = so3.matrix(se3.compose(true, motion)[3:])[2]
    first = Keyframe.spatial(0, motion=motion, up=up)
    pose, covariance = start_of(settings(), None, first)
    np.testing.assert_allclose(pose, true, atol=1e-9)
    np.testing.assert_allclose(np.diagonal(covariance), [0.01, 0.01, 0.01, 0.25, 0.25, 0.01])
    vague = Keyframe.spatial(0, motion=motion, up=up, sigma_up_rad=0.6)
    as_configured, wide = start_of(settings(), None, vague)
    np.testing.assert_allclose(as_configured[3:], so3.exp(np.array([0.0, 0.0, 0.7])), atol=1e-12)
    np.testing.assert_array_equal(wide, covariance)
    told = PoseEstimate(0, "map", true, np.eye(6))
    assert start_of(settings(), told, first)[0] is true
    unfelt, _ = start_of(settings(), None, Keyframe.spatial(0, motion=motion))
    np.testing.assert_allclose(unfelt[3:], so3.exp(np.array([0.0, 0.0, 0.7])), atol=1e-12)

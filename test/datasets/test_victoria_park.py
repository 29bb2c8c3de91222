"""Victoria Park: every pose and detection of the real file arrives in the bag, identities only as ground truth."""

import numpy as np
import pytest
from worlds.bags.imported import import_bag, read_bag, run_import

from semantic_slam.datasets.victoria_park import dead_reckoning, example_path, range_bearing, read_log, stamps
from semantic_slam.errors import InputError

SMALL = """ODOMETRY 0 1 1.0 0.0 1.5707963267948966 0.0001 0 0 4e-06 0 4e-06
LANDMARK 1 2 3.0 4.0 0.4 0 0.4
ODOMETRY 1 3 2.0 0.0 0.0 0.0001 0 0 4e-06 0 4e-06
LANDMARK 3 2 1.0 4.0 0.4 0 0.4
LANDMARK 3 4 0.0 -5.0 0.4 0 0.4
"""


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "victoria_park.txt"
    path.write_text(SMALL)
    return path


def test_poses_and_landmarks_share_one_index_space(small):
    log = read_log(small)
    assert log.num_poses == 3  # vertices 0, 1, 3; vertices 2 and 4 are landmarks
    assert [(seen.pose, seen.landmark) for seen in log.observations] == [(1, "2"), (2, "2"), (2, "4")]


def test_dead_reckoning_composes_increments_in_the_moving_frame(small):
    # One metre along x, a quarter turn to the left, then two metres along the new heading, which is y.
    np.testing.assert_allclose(
        dead_reckoning(read_log(small).increments), [[0, 0, 0], [1, 0, np.pi / 2], [1, 2, np.pi / 2]], atol=1e-12
    )


def test_covariance_in_polar_coordinates_is_that_of_moved_points():
    position, variance = np.array([[3.0, 4.0]]), 1e-4
    _, _, covariance = range_bearing(position, variance)
    moved = position + np.random.default_rng(0).normal(0.0, np.sqrt(variance), (200_000, 2))
    ranges, bearings, _ = range_bearing(moved, variance)
    sampled = np.cov(ranges, bearings)
    np.testing.assert_allclose(covariance[0], sampled, atol=0.02 * variance)


def test_the_drive_takes_as_long_as_it_took():
    assert (stamps(6969)[-1] - stamps(6969)[0]) / 1e9 == pytest.approx(1548.6)


def test_identities_are_ground_truth_only(small, tmp_path, monkeypatch):
    run_import(monkeypatch, "victoria_park", small, "--out", tmp_path / "bag", "--landmark-variance", "0.25")
    bag = read_bag(tmp_path / "bag")
    first, second = bag["/classifier/measurements"]
    assert [m.sequence for m in (first, second)] == [0, 1]
    assert second.track_ids == ("", "")
    assert second.class_names == ()
    np.testing.assert_allclose(second.ranges_m, [np.sqrt(17.0), 5.0])
    np.testing.assert_allclose(second.bearings_rad, [np.arctan2(4.0, 1.0), -np.pi / 2])
    np.testing.assert_allclose(second.geometric_covariances[1], [[0.25, 0.0], [0.0, 0.01]])
    truth = bag["/ground_truth/associations"]
    assert [t.object_ids for t in truth] == [("2",), ("2", "4")]
    assert [t.stamp_ns for t in truth] == [first.stamp_ns, second.stamp_ns]
    assert len(bag["/odom"]) == 3


@pytest.mark.slow
def test_all_of_the_real_file_is_imported(tmp_path, monkeypatch, capsys):
    bag = import_bag(monkeypatch, "victoria_park", "--out", tmp_path / "bag")
    frames = bag["/classifier/measurements"]
    assert len(bag["/odom"]) == 6969
    assert sum(map(len, frames)) == 3640
    assert len(frames) == len(bag["/ground_truth/associations"]) == 3331
    assert max(map(len, frames)) == 2
    assert len({name for truth in bag["/ground_truth/associations"] for name in truth.object_ids}) == 151
    ranges = np.concatenate([frame.ranges_m for frame in frames])
    assert 4.6 < ranges.min() < 4.7 and 20.6 < ranges.max() < 20.8
    assert "6969 poses, 3331 frames with 3640 detections of 151 landmark numbers" in capsys.readouterr().out


@pytest.mark.slow
def test_max_keyframes_counts_frames_with_detections(tmp_path, monkeypatch):
    run_import(monkeypatch, "victoria_park", "--out", tmp_path / "bag", "--max-keyframes", 5)
    bag = read_bag(tmp_path / "bag")
    assert len(bag["/classifier/measurements"]) == 5
    assert bag["/odom"][-1].stamp_ns == bag["/classifier/measurements"][-1].stamp_ns


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("EDGE 0 1 2", "line 1"),
        ("ODOMETRY 0 1 nan 0 0 1 0 0 1 0 1", "line 1"),
        (SMALL + "LANDMARK 77 2 1.0 1.0 0.4 0 0.4", "line 6"),
        ("ODOMETRY 0 1 1 0 0 1 0 0 1 0 1", "no LANDMARK"),
    ],
)
def test_a_file_of_another_kind_is_refused_by_line(tmp_path, text, fault):
    path = tmp_path / "log.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=fault):
        read_log(path)


def test_example_is_found_without_loading_gtsam():
    assert example_path().name == "victoria_park.txt"

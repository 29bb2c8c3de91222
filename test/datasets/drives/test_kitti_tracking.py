"""KITTI tracking: boxes become places, poses odometry and truth, labels the objects and who moves."""

import numpy as np
import pytest
from worlds.bags.imported import import_bag

from semantic_slam.datasets.drives.kitti_tracking import LabelledBoxes, centre_covariances
from semantic_slam.datasets.drives.kitti_tracking_import import noisy_odometry, read_drive
from semantic_slam.datasets.drives.kitti_truth import metre_of, nearest_pairs
from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_pose_vector

FRAMES = 12
PARKED, MOVING, SHORT = 4, 7, 8


def det(frame, x, z, score=0.0, kind=2):
    return f"{frame},{kind},10,20,30,40,{score},1.6,1.7,4.0,{x},1.5,{z},0.0,0.0\n"


def label(frame, track, x, z, kind="Car"):
    return f"{frame} {track} {kind} 0 0 0.0 10 20 30 40 1.6 1.7 4.0 {x} 1.5 {z} 0.0\n"


@pytest.fixture
def folder(tmp_path):
    """A camera that drives a metre per picture straight ahead: past a parked car, behind one as fast as itself."""
    source = tmp_path / "source"
    source.mkdir()
    frames = range(FRAMES)
    poses = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {frame}\n" for frame in frames)
    unknown = "{} -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1\n"
    labels = "".join(
        label(frame, PARKED, 2.0, 30.0 - frame) + label(frame, MOVING, -1.0, 8.0) + unknown.format(frame)
        for frame in frames
    )
    labels += label(FRAMES - 1, SHORT, 5.0, 5.0, "Van")
    detected = det(0, 2.2, 30.1) + det(0, 2.0, 30.4) + det(0, -1.0, 8.3, score=2.0, kind=1) + det(3, 20.0, 8.0)
    for name, text in {"orb": poses, "label": labels, "det": detected}.items():
        (source / f"{name}_0042.txt").write_text(text)
    return source


def run(monkeypatch, folder, *words):
    return import_bag(monkeypatch, "kitti_tracking", folder, "--drive", "0042", *words, "--out", folder.parent / "bag")


def test_centres_of_boxes_are_positions_in_the_body_frame(folder, monkeypatch):
    frames = run(monkeypatch, folder)["/detections"]
    assert [len(frame) for frame in frames] == [3, 0, 0, 1, *[0] * (FRAMES - 4)]
    np.testing.assert_allclose(frames[0].positions[0], [30.1, -2.2, -0.7])  # forward, left, up to half the height
    np.testing.assert_array_equal(frames[0].boxes[0], [10, 20, 30, 40])
    assert frames[0].labels == ("Car", "Car", "Pedestrian")
    np.testing.assert_allclose(frames[0].scores, [0.5, 0.5, 1 / (1 + np.exp(-2))])
    assert frames[0].track_ids == ("", "", "")


def test_associations_are_one_to_one_by_nearness(folder, monkeypatch):
    named = [truth.object_ids for truth in run(monkeypatch, folder)["/ground_truth/associations"]]
    assert named[0] == ("4", "", "moving/7")  # of two near the parked car the nearer one
    assert named[3] == ("",)


def test_parked_and_moving_objects_are_told_apart_and_short_tracks_left_open(folder, monkeypatch):
    objects = run(monkeypatch, folder)["/ground_truth/objects"][0]
    assert objects.object_ids == ("4", "moving/7")
    assert objects.class_names == ("Car", "Car")
    np.testing.assert_allclose(objects.poses[:, :2], [[30.0, -2.0], [8.0, 1.0]])


def test_truth_is_the_poses_and_odometry_without_drift_is_too(folder, monkeypatch):
    bag = run(monkeypatch, folder, "--drift", 0)
    truth = planar_from_pose_vector(np.array([pose.pose for pose in bag["/ground_truth/odom"]]))
    np.testing.assert_allclose(truth, [[frame, 0, 0] for frame in range(FRAMES)], atol=1e-12)
    np.testing.assert_allclose(np.array([pose.pose for pose in bag["/odom"]])[:, 0], range(FRAMES))
    assert np.diff([pose.stamp_ns for pose in bag["/odom"]]).tolist() == [10**8] * (FRAMES - 1)


@pytest.mark.slow
def test_drift_is_that_of_a_metre_however_long_the_steps_are():
    for step_m in (0.1, 2.0):
        poses = np.column_stack([step_m * np.arange(20_001), np.zeros((20_001, 2))])
        odometry = noisy_odometry(poses, 0.06, np.random.default_rng(0))
        errors = se2.log(se2.between(poses[1:2], se2.between(odometry[:-1], odometry[1:])))
        expected = np.array([0.06, 0.06, np.deg2rad(1.0)]) * np.sqrt(step_m)
        np.testing.assert_allclose(errors.std(axis=0), expected, rtol=0.03)


def test_a_seed_gives_one_odometry(folder):
    first, again, other = (read_drive(folder, "0042", 0.03, seed).odometry.poses for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3


def test_pairs_are_nearest_first_and_within_reach():
    centres, others = np.array([[0.0, 0, 0], [1.0, 0, 0], [9.0, 0, 0]]), np.array([[0.9, 0, 0], [2.3, 0, 0]])
    assert nearest_pairs(centres, others) == [-1, 0, -1]
    assert nearest_pairs(centres, np.zeros((0, 3))) == [-1, -1, -1]


def overlap(shift, length):
    return (length - shift) / (length + shift)


@pytest.mark.parametrize(("kind", "least"), [("Car", 0.7), ("Pedestrian", 0.5), ("Cyclist", 0.5)])
def test_a_box_that_is_off_by_two_standard_deviations_is_hardly_right(kind, least):
    """Heading 0: its length lies along the camera's x, the body's -y. As small as the benchmark asks for."""
    (covariance,) = centre_covariances(np.array([[1.5, 1.6, 4.0]]), np.zeros(1), [kind], np.array([25.0]))
    along, across = np.sqrt(covariance[[1, 0], [1, 0]] - 0.1**2)
    assert overlap(2.0 * along, 4.0) == pytest.approx(least)
    assert overlap(2.0 * across, 1.6) == pytest.approx(least)
    np.testing.assert_allclose(covariance, np.diag(np.diagonal(covariance)))


def test_a_box_that_is_twice_as_large_in_the_picture_is_known_twice_as_well_and_to_a_decimetre_at_best():
    sizes = np.tile([1.5, 1.6, 4.0], (4, 1))
    heights = np.array([25.0, 50.0, 1e6, 0.0])
    once, twice, best, none = centre_covariances(sizes, np.zeros(4), ["Car"] * 4, heights)
    least = 0.1**2 * np.eye(3)
    np.testing.assert_allclose(once - least, 4.0 * (twice - least), atol=1e-12)
    np.testing.assert_allclose(best, least, atol=1e-6)
    assert np.isfinite(none).all()


def test_covariances_turn_with_the_box():
    sizes = np.tile([1.5, 1.6, 4.0], (2, 1))
    heights = np.array([25.0, 25.0])
    ahead, aside = centre_covariances(sizes, np.array([-0.5 * np.pi, 0.0]), ["Car", "Car"], heights)
    np.testing.assert_allclose(ahead[[0, 1], [0, 1]], aside[[1, 0], [1, 0]])
    slanted = centre_covariances(sizes[:1], np.array([-0.25 * np.pi]), ["Car"], heights[:1])[0]
    assert slanted[0, 1] < 0.0  # from ahead on the right to behind on the left: x forward, y left


def drive_past(metre, count=8):
    """Poses whose metre is 1 / ``metre`` of the labels', past parked cars and behind one that drives along."""
    frames, tracks, centres = [], [], []
    for frame in range(20):
        for track in range(count):
            frames.append(frame)
            tracks.append(track)
            centres.append([30.0 + 2.0 * track - frame, 3.0, 0.0])
        frames.append(frame)
        tracks.append(count)
        centres.append([10.0, 0.0, 0.0])
    labels = LabelledBoxes(np.array(frames), np.array(tracks), ("Car",) * len(frames), np.array(centres))
    return labels, np.column_stack([np.arange(20) / metre, np.zeros((20, 2))])


def test_the_metre_of_the_labels_is_that_in_which_parked_cars_stand():
    assert metre_of(*drive_past(0.97)) == pytest.approx(0.97)


def test_few_labels_do_not_tell_the_metre():
    assert metre_of(*drive_past(0.97, count=3)) == 1.0


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("det", "0,2,1,2,3,4\n", "line 1: 6 columns, expected frame type"),
        ("det", det(0, "nan", 3.0), "line 1: x is 'nan', not a finite number"),
        ("det", det(3, 1.0, 3.0) + det(2, 1.0, 3.0), "line 2: time goes backwards, from frame 3 to 2"),
        ("det", det(99, 1.0, 3.0), "line 1: frame 99, but there are 12 poses"),
        ("det", det(0, 1.0, 3.0, kind=9), "line 1: type 9 is none of 1, 2, 3"),
        ("label", "0 4 Car 0 0\n", "line 1: 5 columns, expected frame track type"),
        ("orb", "1 0 0 0 0 1 0 0 0 0 1\n", "line 1: 11 columns"),
    ],
)
def test_a_bad_file_is_named_with_its_line(folder, name, text, fault):
    (folder / f"{name}_0042.txt").write_text(text)
    with pytest.raises(InputError, match=fault):
        read_drive(folder, "0042", 0.03, 0)


@pytest.mark.real_data
@pytest.mark.parametrize(("name", "frames", "parked", "detections"), [("0001", 447, 76, 4418), ("0009", 803, 74, 4782)])
def test_parked_cars_are_as_many_as_are_known(data_set, name, frames, parked, detections):
    drive = read_drive(data_set("kitti_tracking"), name, 0.03, 0)
    objects = drive.objects
    stands = [not object_id.startswith("moving/") for object_id in objects.object_ids]
    assert sum(a and b in ("Car", "Van") for a, b in zip(stands, objects.class_names, strict=True)) == parked
    assert len(drive.frames) == frames
    assert sum(map(len, drive.frames)) == detections

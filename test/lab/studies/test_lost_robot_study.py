"""The study of a lost robot: where it begins, what it is told, and how it is judged."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.studies.lost_robot.starts import LOST_M, starts_of
from semantic_slam_lab.studies.lost_robot.study import claims_of
from semantic_slam_lab.studies.real_drives.drives import drives_in
from semantic_slam_lab.studies.real_drives.methods import configuration

HEADER = "# made by hand\n"
FILES = {
    "Barcodes.dat": "1 5\n6 63\n7 81\n",
    "Landmark_Groundtruth.dat": "6 2.0 3.0 0.0001 0.0001\n7 1.0 5.0 0.0001 0.0001\n",
    "Robot1_Odometry.dat": "100.0 1.0 0.0\n110.0 1.0 0.0\n140.0 0.0 0.0\n",
    "Robot1_Measurement.dat": "101.0 63 2.0 0.5\n105.0 63 2.0 0.5\n130.0 81 1.0 0.1\n139.0 81 1.0 0.1\n",
    "Robot1_Groundtruth.dat": "100.0 1.0 1.0 0.0\n110.0 11.0 1.0 0.0\n140.0 41.0 1.0 0.0\n",
}
ROW = {
    "right_clusters": 1.0,
    "ate_m": 0.2,
    "wrong_probability": 0.0,
    "most_wrong_probability": 0.3,
    "cpu_p95_s": 0.5,
    "cpu_max_s": 2.0,
}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = tmp_path / "data" / "mrclam_hand"
    folder.mkdir(parents=True)
    for name, text in FILES.items():
        (folder / name).write_text(HEADER + text)
    return folder.parent


def test_a_start_in_a_long_blind_stretch_is_moved_to_its_end(data: Path) -> None:
    (drive,) = drives_in(data).values()
    early, blind = starts_of(drive, (2.0, 10.0))
    assert early.name == "mrclam_hand/1 from 2.0 s"
    assert [frame.stamp_ns for frame in early.drive.frames] == [n * 10**9 for n in (105, 130, 139)]
    assert blind.name == "mrclam_hand/1 from 29.5 s"
    assert [frame.stamp_ns for frame in blind.drive.frames] == [n * 10**9 for n in (130, 139)]
    np.testing.assert_allclose([item.pose[:2] for item in blind.prior.objects], [[-9.0, 2.0], [-10.0, 4.0]])


@pytest.mark.long
def test_the_initial_pose_is_off_by_up_to_ten_metres_and_says_so(data: Path) -> None:
    (drive,) = drives_in(data).values()
    (start,) = starts_of(drive, (2.0,))
    poses = [start.configuration(configuration(), seed).initial_pose for seed in range(50)]
    away = np.array([np.hypot(*pose.mean[:2]) for pose in poses])
    assert (away <= LOST_M).all()
    assert away.max() > 0.8 * LOST_M
    assert {pose.sigma for pose in poses} == {(10.0, 10.0, 3.14)}
    assert start.configuration(configuration(), 3).initial_pose == poses[3]


def test_a_start_is_right_with_the_cluster_and_the_path() -> None:
    rows = {str(n): ROW for n in range(18)} | {"lost": {**ROW, "ate_m": 4.0}, "beside": {**ROW, "right_clusters": 0.5}}
    assert all(claim.holds for claim in claims_of(rows))
    held = {claim.text: claim.holds for claim in claims_of(rows | {"sure": {**ROW, "most_wrong_probability": 0.95}})}
    assert not held["Wrong with P > 0.9 after any keyframe in none"]
    assert not all(claim.holds for claim in claims_of({**rows, "0": {**ROW, "ate_m": None}}))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.real_data
def test_a_real_robot_that_is_lost_finds_itself(
    tmp_path: Path, data_set: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["--data", str(data_set("mrclam_d6").parent), "--drives", "mrclam_d6/3", "--quick"]
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["run_study", "lost_robot", *words, "--out", str(out)])
    run_study.command()
    (row,) = json.loads((out / "result.json").read_text())["starts"].values()
    assert row["right_clusters"] > 0.9
    assert row["ate_m"] < 0.5
    assert row["right_probability"] > 0.8 and row["wrong_probability"] < 0.05
    assert (out / "result.html").stat().st_size > 1_000

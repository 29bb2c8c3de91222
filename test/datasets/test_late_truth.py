"""Importers say where the truth of a drive begins after its odometry."""

import numpy as np
import pytest

from semantic_slam.datasets.drives.drive import Drive, Path2D, write_drive
from semantic_slam.datasets.space.drive import SpatialDrive, write_spatial_drive
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.geometry.pose import pose_vector_from_planar

SECOND = 1_000_000_000
STAMPS = SECOND * np.arange(1, 12)
POSES = np.column_stack([2.0 + 0.5 * np.arange(11), np.full(11, 7.0), np.deg2rad(7.5) * np.arange(11)])


def planar(bag, late_ns):
    drive = Drive(odometry=Path2D(STAMPS, POSES), frames=[], truth=Path2D(STAMPS + late_ns, POSES))
    write_drive(drive, bag, "mine")


def spatial(bag, late_ns):
    poses = pose_vector_from_planar(POSES)
    odometry, truth = SpatialPath(STAMPS, poses), SpatialPath(STAMPS + late_ns, poses)
    write_spatial_drive(SpatialDrive(start=poses[0], odometry=odometry, frames=[], truth=truth), bag, "mine")


@pytest.mark.parametrize("write", [planar, spatial])
def test_a_truth_that_begins_late_is_told_with_what_was_driven_before_it(tmp_path, capsys, write):
    """After 4 s: 4 times 0.5 m, and 30 degrees."""
    write(tmp_path / "bag", 4 * SECOND)
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("mine: true poses begin 4.0 s after odometry, which had moved by 2.00 m and 30 degrees by")
    assert "ate_m" in line


@pytest.mark.parametrize("late_ns", [0, SECOND // 10, -3 * SECOND // 10])
@pytest.mark.parametrize("write", [planar, spatial])
def test_nothing_is_told_of_a_truth_that_begins_with_odometry_or_before(tmp_path, capsys, write, late_ns):
    write(tmp_path / "bag", late_ns)
    assert capsys.readouterr().out == ""

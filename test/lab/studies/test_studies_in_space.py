"""Studies of hand-held cameras: what is simulated is what an importer reads, and references are where rays meet."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from semantic_slam_lab.documentation.studies.real_in_space import lines
from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.simulation.desks import CAMERA, Office, write_office
from semantic_slam_lab.studies.desks.run import Walked, nearest
from semantic_slam_lab.studies.desks.study import claims_of
from semantic_slam_lab.studies.real_in_space import study as real_in_space
from semantic_slam_lab.studies.real_in_space.reference import meeting_point, true_poses
from semantic_slam_lab.studies.real_in_space.study import CABINET, WITH_DEPTH

from semantic_slam.datasets.space.levelling import OPTICAL
from semantic_slam.datasets.tum_rgbd.folder import read_tum_folder
from semantic_slam.datasets.tum_rgbd.tum_rgbd_import import read_drive
from semantic_slam.geometry import so3

OFFICE = Office(seconds=4.0, edge_share=0.0, edge_px=0.0, settled_share=0.0, missed=0.0, alarms_per_frame=0.0)


def test_boxes_of_simulated_desks_stand_about_the_things_that_they_are_of(tmp_path: Path) -> None:
    things = write_office(tmp_path / "office", OFFICE, np.random.default_rng(0))
    assert len(things.names) == 30
    folder = read_tum_folder(tmp_path / "office")
    drive = read_drive(folder, 0.01, 0)
    assert drive.objects is not None and drive.associations is not None
    assert drive.objects.class_names == things.names
    checked = 0
    poses = true_poses(drive, drive.frames)
    for frame, names, pose in list(zip(drive.frames, drive.associations, poses, strict=True))[::20]:
        seen = so3.rotated(so3.inverse(so3.product(pose[3:], OPTICAL[3:])), drive.objects.positions - pose[:3])
        pixels = seen[:, :2] / seen[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
        for box, name in zip(frame.boxes, names, strict=True):
            u, v = pixels[int(name)]
            if 0.0 < u < CAMERA.width and 0.0 < v < CAMERA.height:
                assert box[0] - 1.0 < u < box[2] + 1.0 and box[1] - 1.0 < v < box[3] + 1.0
                checked += 1
    assert checked > 30


def test_rays_of_a_thing_meet_where_it_stands(tmp_path: Path) -> None:
    """Of a cup, whose box's middle is nearly that of its body; other boxes are left out."""
    write_office(tmp_path / "office", OFFICE, np.random.default_rng(1))
    folder = read_tum_folder(tmp_path / "office")
    drive = read_drive(folder, 0.01, 0)
    assert drive.objects is not None and drive.associations is not None
    seen = [name for names in drive.associations for name in names]
    cups = [
        name for name, kind in zip(drive.objects.object_ids, drive.objects.class_names, strict=True) if kind == "cup"
    ]
    cup = max(cups, key=seen.count)
    rows = [np.flatnonzero([name == cup for name in names]) for names in drive.associations]
    frames = [frame.take(kept) for frame, kept in zip(drive.frames, rows, strict=True)]
    point = meeting_point(drive, frames, folder.camera, OPTICAL)
    assert np.linalg.norm(point - drive.objects.positions[int(cup)]) < 0.05


def test_the_worst_walk_counts() -> None:
    def walk(drift: float, ate_m: float, found: int) -> Walked:
        return Walked(
            seed=0, drift=drift, things=30, found=found, false=1, named_right=found, f1=0.95,
            f1_annotated=0.97, ate_m=ate_m, odometry_ate_m=0.2, nees=6.0, keyframes=9, cpu_s=10.0, times_real=8.0,
        )  # fmt: skip

    claims = claims_of({0.01: [walk(0.01, 0.1, 25), walk(0.01, 0.15, 19)], 0.03: [walk(0.03, 0.15, 25)]})
    assert [claim.holds for claim in claims] == [False, True, True, True, True, True, True, False, True, True]
    assert nearest(np.array([[0.0, 0.1, 0.0], [3.0, 0.0, 0.0]]), np.zeros((1, 3))) == {0: 0}
    assert nearest(np.zeros((0, 3)), np.zeros((1, 3))) == {}


def run_in_space(*errors_m: float | None) -> dict[str, Any]:
    """A run whose path is as good as odometry's and whose objects are off by so much; None: missing."""
    return {
        **{"errors_m": list(errors_m), "num_objects": 5, "ghosts": 0, "num_keyframes": 9, "cpu_s": 1.0},
        **{"ate_m": 0.1, "odometry_ate_m": 0.1, "ate_aligned_m": 0.1, "nees_mean": 6.0},
    }


@pytest.mark.parametrize(
    ("kitchen", "cabinet", "holds"),
    [
        ([0.01] * 5, [0.01], (True, True)),
        ([0.01] * 4, [], (False, False)),  # one of five, and the cabinet, were not even looked for
        ([], [0.01, 0.01], (False, False)),
        ([0.01, 0.01, None, 0.01, 0.01], [None], (False, False)),
        ([0.01, 0.01, 0.08, 0.01, 0.01], [0.11], (False, False)),
    ],
)
def test_real_things_are_all_to_be_asked_for_and_found_near(
    kitchen: list[float | None], cabinet: list[float | None], holds: tuple[bool, bool]
) -> None:
    claims = real_in_space.claims_of({WITH_DEPTH: run_in_space(*kitchen), CABINET: run_in_space(*cabinet)})
    assert tuple(claim.holds for claim in claims if "each" in claim.text) == holds
    if len(kitchen) < 5:
        assert f"{len(kitchen)} of 5 asked for" in claims[0].measured


def test_a_page_shows_what_is_missing_as_a_dash() -> None:
    kept = KeptResults({"real_in_space": {"lines": {"kitchen": run_in_space(0.04, None)}}})
    assert "| kitchen | 0.04, – | 5 |" in lines(kept)

"""The study of real drives: what noise a method is run with, whatever ours chose, on a drive made by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.studies.real_drives import methods
from semantic_slam_lab.studies.real_drives.drives import Drive, drives_in
from semantic_slam_lab.studies.real_drives.methods import AS_CONFIGURED, Chosen
from semantic_slam_lab.studies.real_drives.run import Outcome, Task, outcome_of

from semantic_slam.configuration import Configuration

LANDMARKS = {6: (3.0, 2.0), 7: (6.0, -2.0)}
BARCODES = {6: 63, 7: 81}


@pytest.fixture
def drive(tmp_path: Path) -> Drive:
    """Eight metres straight on past two landmarks, with odometry that turns and sights that are exact."""
    folder = tmp_path / "data" / "mrclam_hand"
    folder.mkdir(parents=True)
    seen = [
        f"{100 + t}.0 {BARCODES[n]} {np.hypot(x - t, y):.6f} {np.arctan2(y, x - t):.6f}"
        for t in range(1, 9)
        for n, (x, y) in LANDMARKS.items()
    ]
    files = {
        "Barcodes.dat": "".join(f"{n} {code}\n" for n, code in BARCODES.items()),
        "Landmark_Groundtruth.dat": "".join(f"{n} {x} {y} 0.0001 0.0001\n" for n, (x, y) in LANDMARKS.items()),
        "Robot1_Odometry.dat": "100.0 1.0 0.04\n108.0 0.0 0.0\n109.0 0.0 0.0\n",
        "Robot1_Measurement.dat": "\n".join(seen) + "\n",
        "Robot1_Groundtruth.dat": "".join(f"{100 + t}.0 {t}.0 0.0 0.0\n" for t in range(9)),
    }
    for name, text in files.items():
        (folder / name).write_text("# made by hand\n" + text)
    (found,) = drives_in(folder.parent).values()
    return found


def base(detection_factors: tuple[float, ...] = (1.0,)) -> Configuration:
    """Odometry is not to be chosen, detections are."""
    own = methods.configuration()
    return replace(
        own,
        odometry=replace(own.odometry, noise_factors=(1.0,), estimate_bias=False),
        perception=replace(own.perception, noise_factors=detection_factors, ranges_are=("distance",)),
    )


def by_batch(drive: Drive, own: Configuration, chosen: Chosen | None) -> Outcome:
    found = outcome_of(Task(drive=drive, method="batch_cauchy", base=own, chosen=chosen))
    assert not found.fault
    return found


@pytest.mark.long
def test_the_robust_batch_takes_the_covariance_that_ours_chose_and_no_other(drive: Drive) -> None:
    """Ours may choose what the configuration states; the first factor of its grid is then not the one chosen."""
    stated = by_batch(drive, base(), AS_CONFIGURED).path
    for chosen in (AS_CONFIGURED, None):
        np.testing.assert_array_equal(by_batch(drive, base((0.01, 1.0)), chosen).path, stated)
    narrower = by_batch(drive, base((0.01, 1.0)), Chosen(detection_factor=0.01)).path
    assert np.abs(narrower - stated).max() > 1e-3


def test_numbers_given_choose_again_where_ours_chose_nothing_and_nowhere_else() -> None:
    own = methods.configuration()
    told = methods.prepared("given", own, AS_CONFIGURED).configuration
    assert told.odometry.noise_factors == told.perception.noise_factors == (1.0,)
    assert told.perception.ranges_are == (AS_CONFIGURED.ranges_are,)
    assert methods.prepared("given", own, None).configuration == replace(own, association="given")
    alone = methods.prepared("jcbb", own, None)
    assert alone == methods.prepared("jcbb", own, AS_CONFIGURED), "one hypothesis cannot choose"


def test_ours_that_fails_chooses_nothing(drive: Drive) -> None:
    without_map = replace(base(), association="enumerated")
    found = outcome_of(Task(drive=drive, method="ours", base=without_map))
    assert "map" in found.fault
    assert found.chosen is None


@pytest.mark.parametrize(("method", "factor"), [("given", 4.0), ("without_correlation", 1.0), ("with_robots", 1.0)])
def test_the_factor_on_odometry_that_a_run_reports_is_that_of_its_own_noise(
    drive: Drive, method: str, factor: float
) -> None:
    """Ablations and runs with other robots start from the noise as configured, not from what ours chose."""
    found = outcome_of(Task(drive=drive, method=method, base=base(), chosen=Chosen(odometry_factor=4.0)))
    assert not found.fault
    assert found.metrics["odometry_factor"] == factor


def test_a_drive_that_cannot_be_read_fails_by_itself(drive: Drive) -> None:
    (drive.folder / "Robot1_Measurement.dat").write_text("not a number\n")
    found = outcome_of(Task(drive=drive, method="ours", base=base()))
    assert "Robot1_Measurement.dat" in found.fault
    assert not found.metrics and found.chosen is None

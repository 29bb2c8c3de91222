"""``semantic_slam calibrate`` on simulated drives: what is wrong is found, and another drive is likelier for it."""

import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from worlds.drives.noisy_drive import STATED, Noise, write_drive

from semantic_slam.calibration.calibrate import Calibration, calibrate
from semantic_slam.calibration.configuration_file import configuration_text
from semantic_slam.calibration.page import render_page
from semantic_slam.calibration.trial import Drive, weigh
from semantic_slam.calibration.truth import truth_beside
from semantic_slam.cli.commands import main
from semantic_slam.configuration import Configuration, from_dict, load_configuration

BEGIN = from_dict(STATED)
OVER_SURE = Noise(odometry=2.0, bias_rad_per_m=0.03)


def call(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["semantic_slam", "calibrate", *map(str, words)])
    with pytest.raises(SystemExit) as left:
        main()
    assert isinstance(left.value.code, int)
    return left.value.code


def configuration_file(path: Path) -> Path:
    path.write_text(yaml.safe_dump(STATED))
    return path


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """Calibration of a drive whose odometry errs twice as much as stated."""
    folder = tmp_path_factory.mktemp("over_sure")
    bag = write_drive(folder / "bag", OVER_SURE, num_keyframes=36)
    return calibrate(Drive(bag=bag), BEGIN, folder / "scratch")


@pytest.mark.long
@pytest.mark.slow
def test_odometry_that_is_over_sure_is_found(found: Calibration) -> None:
    factor = found.after.odometry.sigma_translation_per_m / BEGIN.odometry.sigma_translation_per_m
    assert factor in (2.0, 4.0)
    assert found.changes["odometry.sigma_rotation_per_m"].gain > 10.0
    assert found.after.perception == BEGIN.perception
    assert found.gain == pytest.approx(found.last.log_evidence - found.first.log_evidence)


@pytest.mark.slow
def test_another_drive_of_the_robot_is_likelier(found: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "calibrated.yaml"
    path.write_text(configuration_text(found, "stated.yaml"))
    loaded = load_configuration(path)
    assert loaded == found.after
    other = Drive(bag=write_drive(tmp_path / "bag", OVER_SURE, num_keyframes=16, seed=1))
    before, after = (weigh(other, own, tmp_path / name) for own, name in ((BEGIN, "before"), (loaded, "after")))
    assert after.log_evidence > before.log_evidence + 5.0


@pytest.mark.slow
def test_calibrate_says_how_far_the_configured_noise_was_off(found: Calibration) -> None:
    truth = truth_beside(found)
    assert truth is not None
    assert truth.before.odometry_error == pytest.approx(2.0, abs=0.3)
    assert truth.after.odometry_error < 1.3
    bias, *_, clock = truth.biases
    assert bias.true == pytest.approx(OVER_SURE.bias_rad_per_m, abs=0.015)
    assert abs(bias.off) < 3.0
    assert clock.true == pytest.approx(0.0, abs=0.02) and np.isnan(clock.inferred)  # it was not asked for
    assert truth.after.nees < truth.before.nees
    page = render_page(found, "stated.yaml")
    assert "Against the ground truth" in page and "odometry.bias_rad_per_m" in page


@pytest.mark.long
@pytest.mark.slow
def test_a_robot_that_is_as_stated_keeps_its_noise(tmp_path: Path) -> None:
    bag = write_drive(tmp_path / "bag", Noise(), num_keyframes=12, seed=2)
    same = calibrate(Drive(bag=bag), BEGIN, tmp_path / "scratch")
    assert same.after.odometry.sigma_translation_per_m == BEGIN.odometry.sigma_translation_per_m
    assert same.after.perception == BEGIN.perception


@pytest.mark.long
@pytest.mark.slow
def test_told_covariances_that_are_over_sure_are_found(tmp_path: Path) -> None:
    bag = write_drive(tmp_path / "bag", Noise(detections=2.0, tells_covariances=True), num_keyframes=6)
    found = calibrate(Drive(bag=bag), BEGIN, tmp_path / "scratch")
    assert found.after.perception.noise_factors == (4.0,)
    assert found.after.perception.sigma_range_m == BEGIN.perception.sigma_range_m


@pytest.mark.slow
def test_the_command_writes_a_configuration_and_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, stated = write_drive(tmp_path / "bag", OVER_SURE, 6), configuration_file(tmp_path / "stated.yaml")
    words = (bag, "--config", stated, "--max-keyframes", 4, "--out", tmp_path / "out")
    assert call(monkeypatch, *words) == 0
    assert sorted(item.name for item in (tmp_path / "out").iterdir()) == ["calibrated.yaml", "calibration.html"]
    assert isinstance(load_configuration(tmp_path / "out" / "calibrated.yaml"), Configuration)
    assert "4 keyframes" in (tmp_path / "out" / "calibration.html").read_text()
    assert "over 4 keyframes" in capsys.readouterr().out
    assert call(monkeypatch, *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--overwrite" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--max-keyframes", 0), "--max-keyframes 0: must be at least 1"),
        (("--jobs", 0), "--jobs 0: must be at least 1"),
        (("--config", "nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_bad_input_is_one_line(
    words: tuple[object, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call(monkeypatch, tmp_path / "bag", "--out", tmp_path / "out", *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and not (tmp_path / "out").exists()


def test_a_bag_that_is_not_there_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, tmp_path / "bag", "--out", tmp_path / "out") == 2
    assert "bag" in capsys.readouterr().err and not (tmp_path / "out").exists()

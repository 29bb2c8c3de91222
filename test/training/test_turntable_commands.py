"""train_classifier and fit_viewpoint_models: from a small folder in BigBIRD's format to models that know classes."""

import json
from argparse import Namespace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from worlds.processes import commands

from semantic_slam.cli.turntable_views import in_classes
from semantic_slam.configuration import Configuration, PerceptionConfiguration, SemanticModelConfiguration
from semantic_slam.datasets.bigbird import CAMERAS
from semantic_slam.errors import InputError
from semantic_slam.pipeline.build_classifier import build_classifier
from semantic_slam.training.classifier import TrainingConfiguration, hold_out_angles
from semantic_slam.training.head import HEAD_TRAINING
from semantic_slam.training.turntables import class_names_of, classes_of_folders, load_views, with_classes
from semantic_slam.viewpoint.model import Viewpoints, log_likelihood
from semantic_slam.viewpoint.store import FORMAT, read_model

REPOSITORY = Path(__file__).parents[2]
ANGLES = range(0, 360, 30)
USED = ("NP1", "NP2")
COLOURS = {"red_box": (200, 40, 40), "blue_box": (40, 40, 200)}


def write_turntable(folder: Path, colour: tuple[int, int, int]) -> None:
    """A box with a coloured front and a grey back, on a table that turns before two of the five cameras."""
    for sub in ("masks", "poses"):
        (folder / sub).mkdir(parents=True)
    with h5py.File(folder / "calibration.h5", "w") as file:
        for camera in CAMERAS:
            for lens in ("rgb", "depth", "ir"):
                file[f"{camera}_{lens}_K"] = np.eye(3)
                file[f"{camera}_{lens}_d"] = np.zeros(5)
            file[f"{camera}_ir_depth_scale"] = 1.0
            file[f"H_{camera}_from_NP5"] = np.eye(4)
            file[f"H_{camera}_ir_from_NP5"] = np.eye(4)
    for angle in ANGLES:
        azimuth = np.deg2rad(angle)
        pose = np.eye(4)
        pose[:3, 3] = 2.0 * np.cos(azimuth), 2.0 * np.sin(azimuth), 0.5
        with h5py.File(folder / "poses" / f"NP5_{angle}_pose.h5", "w") as file:
            file["H_table_from_reference_camera"] = pose
        front = 0.5 * (1.0 + np.cos(azimuth))
        picture = np.full((60, 80, 3), 220.0)
        picture[10:50, 20:60] = front * np.array(colour) + (1.0 - front) * 120.0
        mask = np.full((60, 80), 255, dtype=np.uint8)
        mask[10:50, 20:60] = 0
        for camera in USED:
            cv2.imwrite(str(folder / f"{camera}_{angle}.jpg"), picture[..., ::-1].astype(np.uint8))
            cv2.imwrite(str(folder / "masks" / f"{camera}_{angle}_mask.pbm"), mask)


@pytest.fixture(scope="module")
def turntables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("turntables")
    for name, colour in COLOURS.items():
        write_turntable(root / name, colour)
    return root


def call(command: str, *words: str) -> commands.Result:
    return commands.call(REPOSITORY, f"semantic_slam.cli.{command}", *words)


def test_views_know_their_direction_and_their_object(turntables: Path) -> None:
    views = load_views(turntables, USED)
    assert class_names_of(views) == ("blue_box", "red_box")
    assert len(views) == 2 * 2 * len(ANGLES)
    view = next(view for view in views if view.class_name == "red_box" and np.isclose(view.azimuth_rad, np.deg2rad(60)))
    assert view.elevation_rad == pytest.approx(np.arctan2(0.5, 2.0))
    assert view.cutout.shape == (40, 40, 3)
    assert view.mask.min() == 255


def test_all_views_of_an_angle_are_held_out_together_and_none_where_angles_are_few(turntables: Path) -> None:
    views = load_views(turntables, USED)
    few = [view for view in views if view.class_name == "blue_box" or view.angle_deg < 120]
    learned, held_out = hold_out_angles(few)
    assert {view.class_name for view in held_out} == {"blue_box"}
    assert sorted(view.angle_deg for view in held_out) == [60, 60, 210, 210]
    assert {id(view) for view in (*learned, *held_out)} == {id(view) for view in few}
    assert len(learned) + len(held_out) == len(few)


@pytest.mark.long
@pytest.mark.slow
def test_train_then_fit(turntables: Path, tmp_path: Path) -> None:
    weights, models = tmp_path / "network.safetensors", tmp_path / "models.safetensors"
    trained = call(
        "train_classifier",
        *("--turntables", str(turntables), "--out", str(weights), "--cameras", "NP1,NP2"),
        *("--epochs", "2", "--crops-per-epoch", "128", "--max-azimuth-deg", "100"),
    )
    assert trained.returncode == 0, trained.stderr
    assert "classes blue_box, red_box" in trained.stdout
    own = PerceptionConfiguration(network=str(weights))
    with pytest.raises(InputError, match=r"shipped class models: fitted to .* but .* blue_box, red_box"):
        build_classifier(Configuration(perception=own))

    fitted = call(
        "fit_viewpoint_models",
        *("--turntables", str(turntables), "--out", str(models), "--weights", str(weights)),
        *("--cameras", "NP1,NP2", "--draws", "3"),
    )
    assert fitted.returncode == 0, fitted.stderr
    classifier = build_classifier(
        Configuration(perception=own, semantic_model=SemanticModelConfiguration(path=str(models)))
    )
    assert classifier.class_names == ("blue_box", "red_box")
    model = read_model(models)
    assert model.class_names == model.feature_names == ("blue_box", "red_box")
    report = json.loads(models.with_suffix(".json").read_text())
    assert set(report) == set(COLOURS)
    assert report["red_box"]["coverage"]["views"] == len(ANGLES)
    assert FORMAT.read(models)[1]["provenance"]["report"] == report

    front = Viewpoints(np.zeros(1), np.full(1, 0.2), np.full(1, 2.0))
    seen_red = model.predict(np.array([1]), front).mean[0]
    likelihood = log_likelihood(model, seen_red, np.zeros((2, 2)), front)
    assert likelihood[1] > likelihood[0] + 1.0


@pytest.mark.parametrize("command", ["train_classifier", "fit_viewpoint_models"])
def test_wrong_usage_is_one_line(command: str) -> None:
    result = call(command, "--frobnicate")
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert command in result.stderr


def test_help_of_train_classifier_tells_the_defaults() -> None:
    text = " ".join(call("train_classifier", "--help").stdout.split())
    defaults = TrainingConfiguration()
    degrees = round(np.rad2deg(defaults.largest_azimuth_rad))
    of_head = (HEAD_TRAINING.epochs, HEAD_TRAINING.crops_per_epoch)
    for value in ("NP1,NP2,NP3,NP4,NP5", defaults.epochs, defaults.crops_per_epoch, degrees, defaults.seed, *of_head):
        assert f"(default: {value})" in text


@pytest.mark.parametrize(
    "option", [("--draws", "3"), ("--cameras", "NP1"), ("--elevation-step-deg", "10"), ("--classes", "c.json")]
)
def test_an_option_of_turntables_alone_is_refused_with_a_drive(option: tuple[str, str], tmp_path: Path) -> None:
    result = call("fit_viewpoint_models", "--bag", str(tmp_path), *option, "--out", str(tmp_path / "out.safetensors"))
    assert result.returncode == 2
    assert f"{option[0]}: only for --turntables; leave it out" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", ["train_classifier", "fit_viewpoint_models"])
def test_a_folder_without_turntables_is_bad_input(command: str, tmp_path: Path) -> None:
    result = call(command, "--turntables", str(tmp_path), "--out", str(tmp_path / "out.safetensors"))
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert str(tmp_path) in result.stderr


@pytest.mark.slow
def test_weights_that_are_missing_are_said_before_the_turntables_are_read(tmp_path: Path) -> None:
    weights, turntables = tmp_path / "missing.safetensors", tmp_path / "turntables"
    turntables.mkdir()  # without any: reading it is an error, too
    sources = ["--turntables", str(turntables), "--weights", str(weights)]
    result = call("fit_viewpoint_models", *sources, "--out", str(tmp_path / "out.safetensors"))
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert str(weights) in result.stderr


def test_instances_go_under_their_class(turntables: Path, tmp_path: Path) -> None:
    classes = tmp_path / "classes.json"
    classes.write_text(json.dumps({"red_box": "box"}))
    views = load_views(turntables, USED)
    found, lines = with_classes(views, classes)
    assert {view.class_name for view in found} == {"box"}
    assert len(found) == len(views) // 2
    assert lines == ["left out: instances without a class (1): blue_box"]


def test_names_without_a_turntable_are_told(
    turntables: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    classes = tmp_path / "classes.json"
    classes.write_text(json.dumps({"red_box": "box", "blue_box": "box", "blu_box": "box"}))
    views = load_views(turntables, USED)
    assert len(in_classes(Namespace(classes=classes), views)) == len(views)
    assert capsys.readouterr().err.splitlines()[-1] == f"{classes}: names that no turntable has (1): blu_box"
    assert in_classes(Namespace(classes=None), views) == views


def test_mistyped_names_in_a_folder_s_own_file_are_told_and_so_is_what_has_no_class(tmp_path: Path) -> None:
    one, other = tmp_path / "one.json", tmp_path / "other.json"
    one.write_text(json.dumps({"red_box": "box", "blu_box": "box"}))
    other.write_text(json.dumps({"cup_1": "cup"}))
    classes, lines = classes_of_folders([one, other], ("red_box", "blue_box", "cup_1"))
    assert classes == {"red_box": "box", "blu_box": "box", "cup_1": "cup", "blue_box": "blue_box"}
    assert lines == [
        f"{one}: names that no turntable has (1): blu_box",
        f"{one}: instances without a class, each a class of its own (1): blue_box",
    ]
    assert classes_of_folders([], ("red_box",)) == ({}, [])


@pytest.mark.parametrize("text", ["[1]", '{"red_box": 3}', '{"green_box": "box"}', "{", ""])
def test_a_wrong_file_of_classes_is_one_line(text: str, turntables: Path, tmp_path: Path) -> None:
    classes = tmp_path / "classes.json"
    classes.write_text(text)
    with pytest.raises(InputError, match=str(classes)):
        with_classes(load_views(turntables, USED), classes)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("--mask-pattern", "{object}.png"), "only with --pattern"),
        (("--pattern", "{name}.png"), "no field {name}"),
        (("--pattern", "{object}_{azimuth}.gif"), "none of"),
    ],
)
def test_photographs_that_cannot_be_found_are_one_line(
    turntables: Path, tmp_path: Path, words: tuple[str, ...], fault: str
) -> None:
    out = tmp_path / "network.safetensors"
    done = call("train_classifier", "--turntables", str(turntables), "--out", str(out), *words)
    assert done.returncode == 2
    assert fault in done.stderr
    assert "Traceback" not in done.stderr
    assert not out.exists()

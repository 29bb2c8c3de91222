"""train_latent_model: from turntables on disk to a file that inference reads; bad input in one line."""

import json
import shutil
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from semantic_slam.cli import train_latent_model
from semantic_slam.datasets.bigbird import CAMERAS
from semantic_slam.errors import InputError
from semantic_slam.latent.extractor_store import read_extractor
from semantic_slam.latent.store import read_latent_model
from semantic_slam.training.latent.report import of_no_use
from semantic_slam.viewpoint.model import Viewpoints

NAMES = ("cup_01", "cup_02", "cup_03", "box_01")


def write_turntable(folder: Path, shade: int, angles: range) -> None:
    """Two bars that grow and shrink as the table turns, before one camera."""
    for sub in ("masks", "poses"):
        (folder / sub).mkdir(parents=True)
    with h5py.File(folder / "calibration.h5", "w") as file:
        for camera in CAMERAS:
            for lens in ("rgb", "depth"):
                file[f"{camera}_{lens}_K"] = np.eye(3)
            file[f"{camera}_rgb_d"] = np.zeros(5)
            file[f"{camera}_ir_depth_scale"] = 1.0
            file[f"H_{camera}_from_NP5"] = np.eye(4)
    mask = np.full((60, 60), 255, dtype=np.uint8)
    mask[10:50, 10:50] = 0
    for angle in angles:
        turn = np.deg2rad(angle)
        pose = np.eye(4)
        pose[:3, 3] = 2.0 * np.cos(turn), 2.0 * np.sin(turn), 0.5
        with h5py.File(folder / "poses" / f"NP5_{angle}_pose.h5", "w") as file:
            file["H_table_from_reference_camera"] = pose
        picture = np.full((60, 60, 3), shade, dtype=np.uint8)
        picture[10 : round(30 + 19 * np.cos(turn)), :, 0] = 250
        picture[:, 10 : round(30 + 19 * np.sin(turn)), 1] = 250
        cv2.imwrite(str(folder / f"NP1_{angle}.jpg"), picture)
        cv2.imwrite(str(folder / "masks" / f"NP1_{angle}_mask.pbm"), mask)


@pytest.fixture(scope="module")
def turntables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("turntables")
    for index, name in enumerate(NAMES):
        write_turntable(root / name, 40 * index, range(0, 180, 6))
    (root / "classes.json").write_text(json.dumps({name: name.split("_")[0] for name in (*NAMES, "box_l")}))
    return root


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> None:
    monkeypatch.setattr("sys.argv", ["train_latent_model", *map(str, arguments)])
    train_latent_model.command()


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["map", "energy"])
def test_command_learns_and_states_its_figures(
    turntables: Path, tmp_path: Path, formulation: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    out = tmp_path / "deep" / "model.safetensors"
    tags = tmp_path / "tags.json"
    tags.write_text(json.dumps({name: name.split("_")[0] for name in (*NAMES, "cap_01")}))
    options = ("--formulation", formulation, "--held-out", "1", "--cameras", "NP1", "--effort", "0.02", "--tags", tags)
    run(monkeypatch, "--turntables", turntables, "--out", out, *options)
    model, extractor = read_latent_model(out), read_extractor(out)
    assert model.formulation == formulation and model.num_features == extractor.num_features <= 32
    assert len(model.instances.names) == 3 and model.class_names == ("box", "cup")
    (held_out,) = model.provenance["held_out"]  # type: ignore[misc]
    assert held_out.startswith("cup") and held_out not in model.instances.names
    report = model.provenance["report"]
    for place in ("turntable", "rooms"):
        figures = report[place]["views"]  # type: ignore[index]
        assert figures["views"] == 21 and 0.0 <= figures["peak_within_10deg"] <= 1.0
        assert report[place]["held_out"]["objects"] == 1  # type: ignore[index]
    assert model.provenance["tagged"] == 3
    printed = capsys.readouterr()
    assert "identified from one view" in printed.out
    assert f"{turntables / 'classes.json'}: names that no turntable has (1): box_l" in printed.err
    assert f"{tags}: names that no turntable has (1): cap_01" in printed.err
    prediction = model.predict(Viewpoints(np.zeros(1), np.full(1, 0.2), np.ones(1)), model.prior.mean)
    assert np.all(np.isfinite(prediction.mean)) and np.all(prediction.sigma > 0.0)


@pytest.mark.slow
def test_bad_input_is_told_in_one_line(turntables: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = ("--turntables", turntables, "--out", tmp_path / "x.safetensors", "--cameras", "NP1")
    broken = tmp_path / "tags.json"
    broken.write_text("[1]")
    unknown = tmp_path / "unknown.json"
    unknown.write_text(json.dumps({"cup_1": "cup"}))
    wrong = {
        "calibration": ("--turntables", tmp_path / "nothing", "--out", tmp_path / "x.safetensors"),
        "--effort": (*known, "--effort", "0"),
        "and finite": (*known, "--effort", "nan"),
        "tags.json": (*known, "--tags", broken),
        "--tags: name none": (*known, "--tags", unknown),
        "needs 6 instances to learn from, not 3": (*known, "--new-objects", "--held-out", "1", "--effort", "0.01"),
        "--held-out 3": (*known, "--held-out", "3"),
    }
    for expected, arguments in wrong.items():
        with pytest.raises(InputError) as error:
            run(monkeypatch, *arguments)
        assert expected in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--held-out", "3"), "--held-out 3: only 1 instances can be spared; hold out fewer"),
        (("--held-out", "1", "--new-objects"), "--new-objects: needs 6 instances to learn from, not 3; leave it out"),
        (("--tags", "tags.json"), "--tags: name none of the instances that are learned from; correct the names"),
    ],
)
def test_what_the_instances_do_not_allow_is_refused_before_a_picture_is_read(
    turntables: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], told: str
) -> None:
    """Reading these pictures is an error."""
    shutil.copytree(turntables, tmp_path / "turntables")
    for picture in (tmp_path / "turntables").glob("*/*.jpg"):
        picture.write_bytes(b"no picture")
    (tmp_path / "tags.json").write_text(json.dumps({"cup_1": "cup"}))
    monkeypatch.chdir(tmp_path)
    known = ("--turntables", "turntables", "--out", "x.safetensors", "--cameras", "NP1")
    with pytest.raises(InputError, match="not a picture"):
        run(monkeypatch, *known)
    with pytest.raises(InputError) as refused:
        run(monkeypatch, *known, *words)
    assert str(refused.value) == told


@pytest.mark.long
@pytest.mark.slow
def test_pictures_that_do_not_differ_make_a_model_that_is_told_to_be_of_no_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    red = np.zeros((60, 60, 3), dtype=np.uint8)
    red[10:50, 10:50] = 40, 40, 200
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for name in ("one", "two"):
        for angle in range(0, 360, 6):
            cv2.imwrite(str(pictures / f"{name}-{angle}.png"), red)
    options = ("--turntables", pictures, "--pattern", "{object}-{azimuth}.png", "--effort", "0.02")
    run(monkeypatch, *options, "--out", tmp_path / "red.safetensors")
    printed = capsys.readouterr().err
    assert "of 30 new plain views, by chance 0.056: the model tells no direction; give pictures that differ" in printed
    assert "of 30 new plain views, by chance 0.500: the model tells no instance from another; give" in printed


@pytest.mark.parametrize(
    ("peaks", "identified", "views", "instances", "lines"),
    [
        (0.9, 1.0, 8, 2, []),
        (0.25, 1.0, 40, 2, []),  # 10 of 40; by chance 2 are
        (
            0.05,
            1.0,
            40,
            2,
            ["0.050 of 40 new plain views, by chance 0.056: the model tells no direction; give pictures"],
        ),
        (0.9, 0.6, 40, 2, ["0.600 of 40 new plain views, by chance 0.500: the model tells no instance from another"]),
        (0.9, 1.0, 8, 1, []),
    ],
)
def test_a_model_is_of_no_use_where_chance_finds_as_much(
    peaks: float, identified: float, views: int, instances: int, lines: list[str]
) -> None:
    figures = {"peak_within_10deg": peaks, "identification": identified, "views": views, "objects": instances}
    told = of_no_use({"turntable": {"views": figures}})
    assert len(told) == len(lines) and all(line in own for line, own in zip(lines, told, strict=True))

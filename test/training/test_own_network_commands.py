"""fit and train with the network of a configuration: from photographs to a run's classifier, and to no other one's."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from worlds.networks import squeezenet_file
from worlds.processes import commands

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.perception.networks.head import FORMAT as HEAD
from semantic_slam.pipeline.build_classifier import build_classifier
from semantic_slam.viewpoint.store import FORMAT, NETWORK, read_appearance, read_model

REPOSITORY = Path(__file__).parents[2]
BAG = REPOSITORY / "bags" / "standing.mcap"
PATTERN = "{object}-{azimuth}.png"
COLOURS = {"red": (200, 40, 40), "blue": (40, 40, 200)}
CLASSES = ("cup", "teddy")
SCORES = (*CLASSES, "none of these")


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two coloured boxes that turn grey behind, before white."""
    root = tmp_path_factory.mktemp("photographs")
    for name, colour in COLOURS.items():
        for angle in range(0, 360, 30):
            front = 0.5 * (1.0 + np.cos(np.deg2rad(angle)))
            picture = np.full((60, 80, 3), 255.0)
            picture[10:50, 20:60] = front * np.array(colour) + (1.0 - front) * 120.0
            cv2.imwrite(str(root / f"{name}-{angle}.png"), picture[..., ::-1].astype(np.uint8))
    return root


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return squeezenet_file(tmp_path_factory.mktemp("weights") / "squeezenet.pth", seed=0)


def configured(path: Path, weights: Path, models: Path | None = None, **perception: object) -> Path:
    """A configuration file with few dropout passes."""
    named = {"architecture": "squeezenet", "network": str(weights), "num_passes": 4, **perception}
    values = {"perception": named} | ({"semantic_model": {"path": str(models)}} if models else {})
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
    return path


def call(command: str, *words: str | Path) -> commands.Result:
    return commands.call(REPOSITORY, f"semantic_slam.cli.{command}", *map(str, words))


def fitted(photographs: Path, configuration: Path, out: Path) -> commands.Result:
    words = ("--turntables", photographs, "--pattern", PATTERN, "--draws", "2", "--config", configuration)
    return call("fit_viewpoint_models", *words, "--out", out)


def refused(configuration: Configuration, words: str) -> None:
    with pytest.raises(InputError, match=words) as fault:
        build_classifier(configuration)
    assert "\n" not in str(fault.value)


@pytest.fixture(scope="module")
def models(photographs: Path, weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Models fitted to two of ImageNet's classes."""
    folder = tmp_path_factory.mktemp("models")
    done = fitted(
        photographs, configured(folder / "own.yaml", weights, classes=list(CLASSES)), folder / "m.safetensors"
    )
    assert done.returncode == 0, done.stderr
    return folder / "m.safetensors"


@pytest.mark.slow
def test_models_are_of_the_scores_that_the_configuration_names(models: Path, weights: Path, tmp_path: Path) -> None:
    model = read_model(models)
    assert model.class_names == ("blue", "red")
    assert model.feature_names == SCORES
    assert len(FORMAT.read(models)[1][NETWORK]) == 64
    own = load_configuration(configured(tmp_path / "own.yaml", weights, models, classes=list(CLASSES)))
    assert build_classifier(own).class_names == SCORES


@pytest.mark.slow
def test_a_run_with_other_scores_other_weights_or_other_groups_is_refused(
    models: Path, weights: Path, tmp_path: Path
) -> None:
    def with_network(file: Path, **perception: object) -> Configuration:
        return load_configuration(configured(tmp_path / "other.yaml", file, models, **perception))

    refused(with_network(weights, classes=["cup", "desk"]), r"m\.safetensors: fitted to the scores of cup, teddy, none")
    told: list[str] = []  # a node by itself goes on: what it measures may be for a manager with other models
    assert build_classifier(with_network(weights, classes=["cup", "desk"]), told.append).class_names[:2] == (
        "cup",
        "desk",
    )
    assert len(told) == 1 and "fitted to the scores of cup, teddy" in told[0]
    other = squeezenet_file(tmp_path / "other.pth", seed=1)
    refused(with_network(other, classes=list(CLASSES)), r"m\.safetensors: fitted to another network, or to other")
    with pytest.raises(InputError, match="fitted to another network"):
        build_classifier(with_network(other, classes=list(CLASSES)), told.append)
    groups = tmp_path / "groups.yaml"
    groups.write_text("cup: [cup, coffee mug]\n")
    chosen = {"class_groups": str(groups), "classes": ["teddy"]}
    refused(with_network(weights, **chosen), r"m\.safetensors: fitted to another network, or to other")


@pytest.mark.slow
def test_models_without_a_digest_are_known_by_what_the_trunk_makes_of_one_picture(
    models: Path, weights: Path, tmp_path: Path
) -> None:
    arrays, description = FORMAT.read(models)
    del description[NETWORK]
    older = tmp_path / "older.safetensors"
    FORMAT.write(older, arrays, description)
    assert read_appearance(older) is not None
    named = {"classes": list(CLASSES)}
    assert build_classifier(load_configuration(configured(tmp_path / "own.yaml", weights, older, **named)))
    other = squeezenet_file(tmp_path / "other.pth", seed=1)
    refused(load_configuration(configured(tmp_path / "b.yaml", other, older, **named)), "fitted to another network")


@pytest.mark.slow
def test_a_drive_is_measured_with_the_configured_network_too(weights: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.safetensors"
    own = configured(tmp_path / "own.yaml", weights, out, classes=list(CLASSES))
    done = call("fit_viewpoint_models", "--bag", BAG, "--config", own, "--out", out)
    assert done.returncode == 0, done.stderr
    assert read_model(out).feature_names == SCORES
    assert build_classifier(load_configuration(own)).class_names == SCORES
    ran = call("bag_to_report", BAG, "--config", own, "--out", tmp_path / "report", "--max-keyframes", "5")
    assert ran.returncode == 0, ran.stderr
    configured(own, squeezenet_file(tmp_path / "other.pth", seed=1), out, classes=list(CLASSES))
    ran = call("bag_to_report", BAG, "--config", own, "--out", tmp_path / "other", "--max-keyframes", "5")
    assert ran.returncode == 2
    assert f"{out}: fitted to another network" in ran.stderr


@pytest.mark.slow
def test_a_head_is_trained_on_the_configured_trunk_then_models_are_fitted_to_it(
    photographs: Path, weights: Path, tmp_path: Path
) -> None:
    head, models = tmp_path / "head.safetensors", tmp_path / "models.safetensors"
    words = (
        "--turntables",
        photographs,
        "--pattern",
        PATTERN,
        "--config",
        configured(tmp_path / "trunk.yaml", weights),
    )
    trained = call("train_classifier", *words, "--crops-per-epoch", "60", "--out", head)
    assert trained.returncode == 0, trained.stderr
    assert "classes blue, red" in trained.stdout
    description = HEAD.read(head)[1]
    assert description["training"]["crops_per_epoch"] == 60
    assert description["held_out"] == {"views": 2, "accuracy": {"left": 1.0}}  # both at 60 degrees
    own = configured(tmp_path / "own.yaml", weights, models, head=str(head))
    done = fitted(photographs, own, models)
    assert done.returncode == 0, done.stderr
    assert read_model(models).feature_names == ("blue", "red")
    assert build_classifier(load_configuration(own)).class_names == ("blue", "red")


@pytest.mark.slow
def test_the_accuracy_is_that_of_views_not_learned_from(weights: Path, tmp_path: Path) -> None:
    """Red and blue swap their colours at every fifth angle: what was learned from the rest is wrong there."""
    pictures, head = tmp_path / "pictures", tmp_path / "head.safetensors"
    pictures.mkdir()
    for name, other in (("red", "blue"), ("blue", "red")):
        for number, angle in enumerate(range(0, 360, 15)):
            picture = np.full((60, 80, 3), 255, dtype=np.uint8)
            picture[10:50, 20:60] = COLOURS[other if number % 5 == 2 else name]
            cv2.imwrite(str(pictures / f"{name}-{angle}.png"), picture[..., ::-1])
    words = ("--turntables", pictures, "--pattern", PATTERN, "--max-azimuth-deg", "180", "--crops-per-epoch", "60")
    trained = call("train_classifier", *words, "--config", configured(tmp_path / "t.yaml", weights), "--out", head)
    assert trained.returncode == 0, trained.stderr
    shares = "front 0.00, left 0.00, back 0.00, right 0.00"
    assert f"accuracy on 10 held-out views (every fifth angle): {shares}" in trained.stdout
    assert HEAD.read(head)[1]["held_out"]["views"] == 10


@pytest.mark.parametrize(
    ("command", "words", "fault"),
    [
        ("fit_viewpoint_models", ("--config", "detector"), "kind: detector uses no network's scores"),
        ("fit_viewpoint_models", ("--config", "latent"), "kind: latent uses no network's scores"),
        ("fit_viewpoint_models", ("--config", "missing.yaml"), "missing.yaml: No such file"),
        ("fit_viewpoint_models", ("--config", "default", "--weights", "a"), "not allowed with argument"),
        ("train_classifier", ("--config", "default"), "compact is no ImageNet network; set one of alexnet"),
        ("train_classifier", ("--config", "missing.yaml"), "missing.yaml: No such file"),
    ],
)
def test_a_configuration_that_names_no_such_network_is_one_line(
    command: str, words: tuple[str, ...], fault: str, photographs: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.safetensors"
    done = call(command, "--turntables", photographs, "--pattern", PATTERN, *words, "--out", out)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert fault in done.stderr
    assert not out.exists()


@pytest.mark.slow
def test_a_class_without_views_of_its_front_is_one_line(photographs: Path, weights: Path, tmp_path: Path) -> None:
    folder = tmp_path / "some"
    folder.mkdir()
    for file in photographs.glob("*.png"):
        if file.name != "red-0.png":
            (folder / file.name).symlink_to(file)
    trunk = configured(tmp_path / "trunk.yaml", weights)
    words = ("--turntables", folder, "--pattern", PATTERN, "--max-azimuth-deg", "1", "--config", trunk)
    done = call("train_classifier", *words, "--out", tmp_path / "head.safetensors")
    assert done.returncode == 2
    assert "class 'red': no view within 1 degrees of its front" in done.stderr

"""What a user has after ``pip install .`` and ``pip install ./lab``: no source tree, no ROS, no more than declared."""

import json
import shutil
from pathlib import Path

import pytest
from worlds.processes.installed import ROOT, Environment, declared, environment, source_copy, wheel

import semantic_slam

pytestmark = pytest.mark.slow

ALIASES = {
    *("bag_player", "bag_recorder", "classifier_node", "hypothesis_manager_node", "backend_node"),
    *("tf_odometry_node", "demo"),
    *("import_dataset", "bag_to_report", "find_lookalike"),
    *("train_classifier", "fit_viewpoint_models", "train_latent_model"),
    *("run_study", "bench", "make_scene"),
}


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Wheels of the package and of the laboratory."""
    source = source_copy(tmp_path_factory.mktemp("source"))
    return wheel(source, source / "wheel"), wheel(source / "lab", source / "lab" / "wheel")


@pytest.fixture(scope="module")
def plain(wheels: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """``pip install .``"""
    return environment(tmp_path_factory.mktemp("plain"), declared(ROOT).install_requires, wheels[:1])


@pytest.fixture(scope="module")
def with_lab(wheels: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """``pip install . ./lab``"""
    needs = [text for text in declared(ROOT / "lab").install_requires if not text.startswith("semantic_slam")]
    return environment(tmp_path_factory.mktemp("lab"), [*needs, *declared(ROOT).install_requires], wheels)


@pytest.mark.long
def test_a_bag_is_reported_from_an_empty_folder(plain: Environment, tmp_path: Path) -> None:
    for name in ("standing.mcap", "standing.objects.json"):
        shutil.copy(ROOT / "bags" / name, tmp_path)
    words = ("semantic_slam", "report", "standing.mcap", "--out", "out", "--max-keyframes", "2", "--config", "standing")
    told = plain.run(*words, cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert len(report["keyframes"]) == 2
    assert report["config"]["semantic_model"]["kind"] == "gp_correlated"
    assert report["revision"] == semantic_slam.__version__
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


def test_version_and_names_are_those_of_the_project(plain: Environment, tmp_path: Path) -> None:
    assert (
        plain.run("semantic_slam", "--version", cwd=tmp_path).stdout == f"semantic_slam {semantic_slam.__version__}\n"
    )
    assert {path.name for path in (plain.folder / "bin").iterdir()} >= ALIASES


@pytest.mark.parametrize("words", [("semantic_slam", "study"), ("semantic_slam", "bench"), ("make_scene",)])
def test_without_the_laboratory_its_commands_name_the_remedy(
    plain: Environment, tmp_path: Path, words: tuple[str, ...]
) -> None:
    told = plain.run(*words, "--help", cwd=tmp_path)
    assert (told.returncode, told.stderr.count("\n")) == (2, 1)
    assert told.stderr.startswith(f"{' '.join(words)}: ") and "pip install ./lab" in told.stderr


@pytest.mark.parametrize("words", [("semantic_slam", "demo"), ("bag_player",), ("backend_node", "--help")])
def test_without_ros_the_nodes_say_so(plain: Environment, tmp_path: Path, words: tuple[str, ...]) -> None:
    told = plain.run(*words, cwd=tmp_path)
    assert (told.returncode, told.stderr.count("\n")) == (2, 1)
    assert "needs rclpy" in told.stderr and "semantic_slam report" in told.stderr


def test_without_the_extra_for_training_a_fit_names_it(plain: Environment, tmp_path: Path) -> None:
    told = plain.run("semantic_slam", "fit", "--bag", "any", "--out", "model.safetensors", cwd=tmp_path)
    assert (told.returncode, told.stderr.count("\n")) == (2, 1)
    assert told.stderr.startswith("semantic_slam fit: needs matplotlib and sklearn") and "[train]" in told.stderr


@pytest.mark.long
def test_the_laboratory_brings_its_commands(with_lab: Environment, tmp_path: Path) -> None:
    studies = with_lab.run("semantic_slam", "study", "--list", cwd=tmp_path)
    assert studies.returncode == 0 and "victoria_park" in studies.stdout.splitlines()
    assert with_lab.run("run_study", "--list", cwd=tmp_path).stdout == studies.stdout
    assert "usage: semantic_slam bench" in with_lab.run("semantic_slam", "bench", "--help", cwd=tmp_path).stdout
    assert "usage: make_scene" in with_lab.run("make_scene", "--help", cwd=tmp_path).stdout


@pytest.mark.long
def test_an_installed_study_finds_its_templates_and_scenarios(with_lab: Environment, tmp_path: Path) -> None:
    told = with_lab.run("semantic_slam", "study", "ch4_example", "--quick", "--out", "out", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert (tmp_path / "out" / "result.html").is_file()

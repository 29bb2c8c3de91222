"""docs/extending.md is carried out: a foreign package is installed, a bag runs with it from YAML alone."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from worlds.processes.commands import call

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "examples" / "foreign_package"
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a user who has installed the package."""
    folder = tmp_path_factory.mktemp("foreign")
    words = ["install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target", str(folder / "site")]
    source = folder / "source"
    source.mkdir()
    for path in PACKAGE.rglob("*"):  # without what building leaves in a tree
        if path.suffix in (".py", ".toml", ".json"):
            (source / path.relative_to(PACKAGE)).parent.mkdir(exist_ok=True)
            (source / path.relative_to(PACKAGE)).write_bytes(path.read_bytes())
    subprocess.run([sys.executable, "-m", "pip", *words, str(source)], check=True, timeout=300)
    path = os.pathsep.join([str(folder / "site"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path}


def told(environment: dict[str, str], *words: object, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, *map(str, words)]
    return subprocess.run(line, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300)


@pytest.mark.long
@pytest.mark.slow
def test_a_bag_runs_with_a_foreign_class_model_from_yaml_alone(foreign: dict[str, str], tmp_path: Path) -> None:
    def words(name: str, config: Path | str) -> tuple[object, ...]:
        return ("report", "bags/aliased_room", "--out", tmp_path / name, "--config", config, "--max-keyframes", 1)

    run = told(foreign, "-m", "semantic_slam.cli.commands", *words("foreign", PACKAGE / "foreign.yaml"))
    assert run.returncode == 0, run.stderr
    assert call(ROOT, "semantic_slam.cli.commands", *words("ours", "default")).returncode == 0
    reports = {name: json.loads((tmp_path / name / "report.json").read_text()) for name in ("foreign", "ours")}
    assert reports["foreign"]["config"]["semantic_model"]["kind"] == "viewpoint_table"
    assert reports["ours"]["config"]["semantic_model"]["kind"] == "gp_independent"
    beliefs = {name: report["objects"] for name, report in reports.items()}
    names = {name: set(objects[0]["class_probabilities"]) for name, objects in beliefs.items()}
    assert names["foreign"] == names["ours"]  # those of the table, which was made from the shipped models
    assert beliefs["foreign"] != beliefs["ours"]


@pytest.mark.slow
def test_the_foreign_package_passes_its_contract_test(foreign: dict[str, str], tmp_path: Path) -> None:
    copied = tmp_path / "test_viewpoint_table.py"
    copied.write_bytes((PACKAGE / copied.name).read_bytes())
    run = told(foreign, "-m", "pytest", "-q", copied, "-p", "no:cacheprovider", cwd=tmp_path)
    assert run.returncode == 0 and " passed" in run.stdout and "failed" not in run.stdout, run.stdout


@pytest.mark.slow
def test_saved_configurations_admit_the_foreign_name(foreign: dict[str, str]) -> None:
    line = (
        "import sys; from semantic_slam.configuration import Configuration, from_dict, to_dict;"
        "c = Configuration.of(semantic_model={'kind': 'viewpoint_table'}); assert from_dict(to_dict(c)) == c"
    )
    assert told(foreign, "-c", line).returncode == 0


@pytest.mark.slow
def test_without_the_package_its_name_is_refused_with_those_that_are_known(tmp_path: Path) -> None:
    words = ("report", "bags/aliased_room", "--out", tmp_path / "out", "--config", PACKAGE / "foreign.yaml")
    run = call(ROOT, "semantic_slam.cli.commands", *words)
    assert run.returncode == 2 and run.stderr.count("\n") == 1
    assert "'viewpoint_table'" in run.stderr and "gp_independent" in run.stderr


def test_the_page_shows_the_files_as_they_are() -> None:
    shown = dict(re.findall(r"`examples/foreign_package/([\w./]+)`:\n\n```\w+\n(.*?)```", PAGE, re.DOTALL))
    assert set(shown) == {"viewpoint_table/__init__.py", "pyproject.toml", "test_viewpoint_table.py", "foreign.yaml"}
    for name, text in shown.items():
        assert text == (PACKAGE / name).read_text(encoding="utf-8"), name

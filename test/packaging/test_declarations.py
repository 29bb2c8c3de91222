"""Versions stand in one place, and what is imported is declared and pinned."""

import ast
import re
from collections.abc import Iterable
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from sys import stdlib_module_names
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from worlds.processes.installed import ROOT, declared

import semantic_slam

VERSION = ElementTree.parse(ROOT / "package.xml").findtext("version")
pytestmark = pytest.mark.filterwarnings("ignore:pkg_resources is deprecated")  # setuptools says so of itself

OURS = {"semantic_slam", "semantic_slam_lab"}
OF_ROS = {"rclpy", "rcl_interfaces", "lifecycle_msgs", "semantic_slam_msgs", "std_srvs", "launch", "launch_ros"}
"""What only the nodes and launch files import, and what kills and forges in the laboratory; ROS brings it."""
TRAINING = "semantic_slam/training/"
"""What only the commands import that fit models."""
CLUSTER = "semantic_slam/cluster.py"
"""What only ``--scheduler`` imports."""
CONTRACTS = "semantic_slam/contracts/"
"""What only tests import, ours and those of packages that extend us."""


def names(requirements: Iterable[str]) -> set[str]:
    return {canonicalize_name(Requirement(text).name) for text in requirements}


@cache
def imported(folder: Path) -> dict[str, set[str]]:
    """Foreign modules that the files below ``folder`` import, and the files, relative to the root, that do."""
    found: dict[str, set[str]] = {}
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for module in {module.split(".")[0] for module in modules} - OURS - set(stdlib_module_names):
                found.setdefault(module, set()).add(path.relative_to(ROOT).as_posix())
    return found


providers_of_all = cache(packages_distributions)
"""It reads what every distribution says of itself."""


def distributions(modules: Iterable[str], known: set[str]) -> set[str]:
    """Distributions that provide ``modules``: those of ``known`` where several share a module, as mujoco's do."""
    providers = providers_of_all()
    found = [[canonicalize_name(name) for name in providers[module]] for module in modules]
    return {next((name for name in names if name in known), names[0]) for names in found}


def pins() -> dict[str, str]:
    """{distribution: version} of all requirements that CI installs."""
    lines = [line for path in (ROOT / "requirements").glob("*.txt") for line in path.read_text().splitlines()]
    return {
        canonicalize_name(name): version for name, version in re.findall(r"^([\w.-]+)==(\S+)$", "\n".join(lines), re.M)
    }


@pytest.mark.parametrize("folder", [".", "lab"])
def test_projects_have_the_version_of_package_xml(folder: str) -> None:
    assert declared(ROOT / folder).metadata.version == VERSION


def test_the_package_says_the_version_of_package_xml() -> None:
    assert semantic_slam.__version__ == VERSION


def test_the_messages_have_the_same_version() -> None:
    assert ElementTree.parse(ROOT / "msg_defs" / "package.xml").findtext("version") == VERSION


def test_the_laboratory_needs_the_same_version() -> None:
    (ours,) = (text for text in declared(ROOT / "lab").install_requires if text.startswith("semantic_slam"))
    assert str(Requirement(ours).specifier) == f"=={VERSION}"


def test_the_citation_names_the_same_version() -> None:
    path = ROOT / "CITATION.cff"
    found = re.findall(r"^version: *\"?([^\"\s]+)", path.read_text(), re.M) if path.is_file() else []
    assert found in ([], [VERSION])


@pytest.mark.long
@pytest.mark.slow
def test_run_time_imports_are_exactly_the_declared_dependencies() -> None:
    used = imported(ROOT / "semantic_slam")
    apart = (TRAINING, CLUSTER, CONTRACTS)
    modules = {name for name, files in used.items() if not all(file.startswith(apart) for file in files)}
    known = names(declared(ROOT).install_requires)
    assert distributions(modules - OF_ROS, known) == known


@pytest.mark.slow
def test_what_only_training_imports_is_the_extra_of_that_name() -> None:
    used = imported(ROOT / "semantic_slam")
    modules = {name for name, files in used.items() if all(file.startswith(TRAINING) for file in files)}
    known = names(declared(ROOT).extras_require["train"])
    assert distributions(modules, known) == known


@pytest.mark.slow
def test_what_only_a_cluster_needs_is_the_extra_of_its_scheduler() -> None:
    used = imported(ROOT / "semantic_slam")
    modules = {name for name, files in used.items() if files == {CLUSTER}}
    known = names(declared(ROOT).extras_require["scheduler"])
    assert modules and distributions(modules, known) <= known


@pytest.mark.slow
def test_what_only_contracts_import_is_for_development() -> None:
    used = imported(ROOT / "semantic_slam")
    modules = {name for name, files in used.items() if all(file.startswith(CONTRACTS) for file in files)}
    known = names(declared(ROOT).extras_require["dev"])
    assert modules and distributions(modules, known) <= known


@pytest.mark.slow
def test_only_the_nodes_import_ros() -> None:
    used = imported(ROOT / "semantic_slam")
    assert all(file.startswith("semantic_slam/ros/") for name in OF_ROS & set(used) for file in used[name])


@pytest.mark.long
@pytest.mark.slow
def test_imports_of_the_laboratory_are_declared() -> None:
    lab = declared(ROOT / "lab")
    known = names(lab.install_requires) | names(lab.extras_require["scheduler"])
    assert distributions(set(imported(ROOT / "lab" / "semantic_slam_lab")) - OF_ROS, known) <= known


@pytest.mark.parametrize("folder", [".", "lab"])
def test_what_ci_installs_lies_in_the_declared_ranges(folder: str) -> None:
    project, pinned = declared(ROOT / folder), pins()
    texts = [*project.install_requires, *(text for extra in project.extras_require.values() for text in extra)]
    wanted = [Requirement(text) for text in texts if not text.startswith("semantic_slam")]
    found = {each.name: pinned.get(canonicalize_name(each.name), "no pin") for each in wanted}
    assert [name for name, version in found.items() if version == "no pin"] == []
    assert [str(each) for each in wanted if not each.specifier.contains(found[each.name])] == []

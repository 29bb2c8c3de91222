"""No import circle, between modules or between folders, where imports in functions and for types alone count too."""

import ast
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from worlds.processes.installed import ROOT

Graph = dict[str, set[str]]
PACKAGES = {"semantic_slam": ROOT / "semantic_slam", "semantic_slam_lab": ROOT / "lab" / "semantic_slam_lab"}


def modules(package: str, root: Path) -> dict[str, Path]:
    """File of every module below a package; that of a folder's own file ends in ``__init__``."""
    return {
        ".".join((package, *path.relative_to(root).with_suffix("").parts)): path for path in sorted(root.rglob("*.py"))
    }


def imported(path: Path, known: Mapping[str, Path]) -> set[str]:
    """Modules among ``known`` that a file imports anywhere in it."""
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            parts = [f"{module}.{alias.name}" for alias in node.names]
            names += [name if {name, f"{name}.__init__"} & known.keys() else module for name in parts]
    return known.keys() & {each for name in names for each in (name, f"{name}.__init__")}


@cache
def imports(package: str) -> Graph:
    """{module: modules of its package that it imports}; what Python loads on the way to them does not count."""
    known = modules(package, PACKAGES[package])
    return {name: imported(path, known) - {name} for name, path in known.items()}


def rooms(graph: Graph, folder: str) -> Graph:
    """{part: other parts that it imports} of what lies directly in a folder: modules, and folders as wholes."""
    depth, parts = folder.count(".") + 2, Graph()
    for module, targets in graph.items():
        if module.startswith(f"{folder}."):
            part = ".".join(module.split(".")[:depth])
            inside = {".".join(target.split(".")[:depth]) for target in targets if target.startswith(f"{folder}.")}
            parts[part] = parts.get(part, set()) | inside - {part}
    return parts


def circle(graph: Graph) -> list[str]:
    """Some circle of a graph, [] where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as fault:
        return list(fault.args[1])
    return []


@pytest.mark.long
@pytest.mark.parametrize("package", PACKAGES)
def test_no_modules_import_each_other(package: str) -> None:
    assert circle(imports(package)) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folders_import_each_other(package: str) -> None:
    graph = imports(package)
    folders = {module.rpartition(".")[0] for module in graph}
    assert {folder: found for folder in folders if (found := circle(rooms(graph, folder)))} == {}


def test_imports_in_functions_and_for_types_count(tmp_path: Path) -> None:
    texts = {
        "a": "def late():\n    from p import b\n",
        "b": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import p.a\n",
        "in/__init__": "",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.py").parent.mkdir(exist_ok=True)
        (tmp_path / f"{name}.py").write_text(text)
    known = modules("p", tmp_path)
    graph = {name: imported(path, known) for name, path in known.items()}
    assert graph == {"p.a": {"p.b"}, "p.b": {"p.a"}, "p.in.__init__": set()}
    assert set(circle(graph)) == {"p.a", "p.b"}

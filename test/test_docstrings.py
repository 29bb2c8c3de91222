"""Docstrings are read alone, in an editor's hover box: none leans on the line above it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (ROOT / "semantic_slam", ROOT / "lab" / "semantic_slam_lab")
LEANING = ("The same", "Of ", "Likewise", "As before", "Those ", "These ", "Its ", "And ", "As ", "Who ")
"""Beginnings that refer to what stands before, which a hover box does not show."""


def docstrings(file: Path) -> Iterator[tuple[int, str]]:
    """Line and text of every string that stands alone in a file: docstrings, and what is said under constants."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_docstrings_stand_alone(package: Path) -> None:
    files = sorted(package.rglob("*.py"))
    leaning = [
        f"{file.relative_to(ROOT)}:{line}: {text.strip().splitlines()[0]}"
        for file in files
        for line, text in docstrings(file)
        if text.strip().startswith(LEANING)
    ]
    assert files and not leaning, "\n".join(leaning)

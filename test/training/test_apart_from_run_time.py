"""Nothing that runs on a robot needs what its models were fitted with."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "semantic_slam"
RUN_TIME = ("perception", "viewpoint", "latent", "classification", "inference", "pipeline", "ros", "report")


def imported(path: Path) -> set[str]:
    """Modules that a file imports anywhere, in functions too."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("room", RUN_TIME)
def test_run_time_imports_no_training(room: str) -> None:
    files = sorted((PACKAGE / room).rglob("*.py"))
    assert files
    assert not [path for path in files if any("semantic_slam.training" in name for name in imported(path))]

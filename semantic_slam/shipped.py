"""The configurations that come with the package."""

from pathlib import Path

CONFIGURATIONS = Path(__file__).parent / "configurations"
"""Folder of the shipped configurations; in a checkout this is config/."""
DEFAULT_CONFIGURATION = CONFIGURATIONS / "default.yaml"


def configuration_file(name: str) -> Path:
    """Configuration file for ``name``: a path, or the name of a shipped configuration such as ``open_world``."""
    path, shipped = Path(name), CONFIGURATIONS / f"{name}.yaml"
    return shipped if shipped.is_file() and not path.is_file() else path

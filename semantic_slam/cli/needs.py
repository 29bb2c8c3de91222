"""Checks, before any work is done, for optional dependencies that some commands need."""

from importlib.util import find_spec

from semantic_slam.cli.exit_codes import program
from semantic_slam.errors import InputError

TRAINING = ("matplotlib", "sklearn")
"""Modules installed by the extra ``train``."""


def need_training() -> None:
    """Raises InputError if the extra ``train`` is not installed."""
    _need(TRAINING, "install the extra [train] from a checkout: pip install '.[train]'")


def need_ros() -> None:
    """Raises InputError if no ROS 2 is sourced."""
    _need(("rclpy",), "source ROS 2 (env.sh of a checkout does), or use semantic_slam report, which needs none")


def _need(modules: tuple[str, ...], remedy: str) -> None:
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise InputError(f"{program()}: needs {' and '.join(missing)}, not found here; {remedy}")

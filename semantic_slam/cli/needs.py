"""What some commands need besides the package's own dependencies, said before any work is done."""

from importlib.util import find_spec

from semantic_slam.cli.exit_codes import program
from semantic_slam.errors import InputError

TRAINING = ("matplotlib", "sklearn")
"""Modules of the extra ``train``."""


def need_training() -> None:
    """Raises InputError where the extra ``train`` is not installed."""
    _need(TRAINING, "install the extra [train] from a checkout: pip install '.[train]'")


def need_ros() -> None:
    """Raises InputError where no ROS 2 is sourced."""
    _need(("rclpy",), "source ROS 2 (env.sh of a checkout does), or use semantic_slam report, which needs none")


def _need(modules: tuple[str, ...], remedy: str) -> None:
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise InputError(f"{program()}: needs {' and '.join(missing)}, not found here; {remedy}")

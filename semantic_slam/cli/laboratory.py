"""Commands of the separate package semantic_slam_lab, found by their entry points: studies, benchmarks, rooms."""

from collections.abc import Callable
from importlib.metadata import entry_points

from semantic_slam.cli.exit_codes import program, run_main
from semantic_slam.errors import InputError

GROUP = "semantic_slam.commands"
"""Entry point group of commands: functions without arguments that exit the process with an exit code."""


def study() -> None:
    """Command ``semantic_slam study``, alias ``run_study``."""
    run_main(lambda: announced("study")())


def bench() -> None:
    """Command ``semantic_slam bench``, alias ``bench``."""
    run_main(lambda: announced("bench")())


def scene() -> None:
    """Command ``semantic_slam scene``, alias ``make_scene``."""
    run_main(lambda: announced("scene")())


def announced(name: str) -> Callable[[], None]:
    """The command that an installed package provides under ``name``; raises InputError if none does."""
    for found in entry_points(group=GROUP, name=name):
        command: Callable[[], None] = found.load()
        return command
    raise InputError(
        f"{program()}: belongs to the laboratory, which is not installed; install it from a checkout: pip install ./lab"
    )

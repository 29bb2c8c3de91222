"""Commands of the laboratory, a package of its own that announces them as entry points: studies, benchmarks, rooms."""

from collections.abc import Callable
from importlib.metadata import entry_points

from semantic_slam.cli.exit_codes import program, run_main
from semantic_slam.errors import InputError

GROUP = "semantic_slam.commands"
"""Entry points of this group are commands without arguments that leave the process with an exit code."""


def study() -> None:
    """``semantic_slam study``, ``run_study``."""
    run_main(lambda: announced("study")())


def bench() -> None:
    """``semantic_slam bench``, ``bench``."""
    run_main(lambda: announced("bench")())


def scene() -> None:
    """``semantic_slam scene``, ``make_scene``."""
    run_main(lambda: announced("scene")())


def announced(name: str) -> Callable[[], None]:
    """The command that an installed package announces under ``name``; raises InputError where none does."""
    for found in entry_points(group=GROUP, name=name):
        command: Callable[[], None] = found.load()
        return command
    raise InputError(
        f"{program()}: belongs to the laboratory, which is not installed; install it from a checkout: pip install ./lab"
    )

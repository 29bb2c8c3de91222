"""Commands called as a console calls them, in this process: to start one takes seconds that tell nothing."""

import contextlib
import io
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest


@dataclass(frozen=True)
class Result:
    """How a command ended, and what it said."""

    returncode: int
    stdout: str
    stderr: str


def call(folder: Path, module: str, *words: object) -> Result:
    """``main`` of a command's module, in ``folder``."""
    main = import_module(module).main
    said, complained, code = io.StringIO(), io.StringIO(), 0
    with pytest.MonkeyPatch.context() as patch, contextlib.chdir(folder):
        patch.setattr(sys, "argv", [module.rpartition(".")[2], *map(str, words)])
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complained):
            try:
                main()
            except SystemExit as left:
                assert isinstance(left.code, int)
                code = left.code
    return Result(code, said.getvalue(), complained.getvalue())

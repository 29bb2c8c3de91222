"""Environments in which our packages are installed as a user has them: no source tree, no more than declared."""

import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from setuptools import Distribution as Project

ROOT = Path(__file__).parents[3]
BUILT_FROM = ("semantic_slam", "config", "launch", "msg_defs", "resource", "lab")
"""Folders that a wheel is built from."""


@dataclass(frozen=True)
class Environment:
    """A virtual environment's folder."""

    folder: Path

    def run(self, *words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
        """Run an executable of this environment, which sees nothing of ours but what is installed in it."""
        environment = {"PATH": f"{self.folder / 'bin'}:/usr/bin:/bin", "HOME": str(cwd)}
        line = [str(self.folder / "bin" / words[0]), *map(str, words[1:])]
        return subprocess.run(line, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300)


def declared(folder: Path) -> Project:
    """What the setup.py of ``folder`` (and its pyproject.toml) says of the project."""
    from distutils.core import run_setup  # after setuptools, whose own it then is

    before = Path.cwd()
    os.chdir(folder)
    try:
        project = run_setup("setup.py", stop_after="init")
        project.parse_config_files()
    finally:
        os.chdir(before)
    return project


def wheel(project: Path, into: Path) -> Path:
    """Build the wheel of a project."""
    words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(into), str(project)]
    subprocess.run([sys.executable, "-m", "pip", *words], check=True, timeout=300)
    (built,) = into.glob("*.whl")
    return built


def source_copy(into: Path) -> Path:
    """The source tree in ``into``, where building leaves its traces."""
    for name in BUILT_FROM:
        ignored = shutil.ignore_patterns("build", "__pycache__", "*.egg-info")
        shutil.copytree(ROOT / name, into / name, symlinks=True, ignore=ignored)
    for name in ("setup.py", "setup.cfg", "pyproject.toml", "package.xml"):
        shutil.copy(ROOT / name, into)
    return into


def environment(folder: Path, requirements: Iterable[str], wheels: Iterable[Path]) -> Environment:
    """An environment with ``wheels``, and links to what ``requirements`` bring where this Python has it."""
    venv.create(folder, symlinks=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    linked = folder / "linked"
    linked.mkdir()
    for name in closure(requirements):
        _link(distribution(name), linked)
    (packages / "linked.pth").write_text(f"{linked}\n", encoding="utf-8")
    words = ["--python", str(folder / "bin" / "python"), "install", "--quiet", "--no-deps", "--no-index"]
    # On PYTHONPATH pip would find our packages installed already.
    outside = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    line = [sys.executable, "-m", "pip", *words, *map(str, wheels)]
    subprocess.run(line, check=True, timeout=300, env=outside)
    return Environment(folder)


def closure(requirements: Iterable[str]) -> set[str]:
    """Names of the distributions that ``requirements`` bring, their own requirements included."""
    found: set[str] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        if name not in found and (wanted.marker is None or wanted.marker.evaluate({"extra": ""})):
            found.add(name)
            waiting += [Requirement(text) for text in distribution(name).requires or ()]
    return found


def _link(of: Distribution, into: Path) -> None:
    """Link every file and folder that a distribution has put into the folder of packages."""
    tops = {path.parts[0] for path in of.files or ()} - {"..", "__pycache__"}
    for top in tops:
        source = Path(str(of.locate_file(top)))
        if source.exists() and not (into / top).exists():
            (into / top).symlink_to(source)

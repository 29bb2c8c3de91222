"""Provenance of a result: its input, the version of this software, the machine."""

import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

from semantic_slam.version import PACKAGE_XML, __version__


def source_text(path: Path, sha256: str) -> str:
    """JSON with path and SHA-256 of a run's input bag, as stored in RunConfiguration."""
    return json.dumps({"path": str(path.resolve()), "sha256": sha256})


def revision() -> str:
    """Version of this package, with the git revision if it runs from a checkout."""
    root = PACKAGE_XML.parent
    if not (root / ".git").exists():
        return __version__
    command = ["git", "-C", str(root), "describe", "--always", "--dirty"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return __version__
    return f"{__version__}+{found}"


def machine() -> dict[str, Any]:
    """Processor, number of cores available to this process, and Python version, on which timings depend."""
    return {"cpu": _processor(), "cores": len(os.sched_getaffinity(0)), "python": platform.python_version()}


def _processor() -> str:
    """Processor name from /proc/cpuinfo; where there is none, the machine architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()

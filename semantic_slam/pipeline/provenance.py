"""Where a result comes from: its input, the version of this software, the machine."""

import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

from semantic_slam.version import PACKAGE_XML, __version__


def source_text(path: Path, sha256: str) -> str:
    """JSON of a run's input, as RunConfiguration carries it."""
    return json.dumps({"path": str(path.resolve()), "sha256": sha256})


def revision() -> str:
    """Version of this package, with the git revision when it runs from a checkout."""
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
    """Processor, cores that this process may use, and Python: what times in a result depend on."""
    return {"cpu": _processor(), "cores": len(os.sched_getaffinity(0)), "python": platform.python_version()}


def _processor() -> str:
    """The processor's name as Linux states it, elsewhere its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()

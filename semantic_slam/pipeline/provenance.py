"""Where a result comes from: its input and the version of this software."""

import json
import subprocess
from pathlib import Path

import semantic_slam


def source_text(path: Path, sha256: str) -> str:
    """JSON of a run's input, as RunConfiguration carries it."""
    return json.dumps({"path": str(path.resolve()), "sha256": sha256})


def revision() -> str:
    """Version of this package, with the git revision when it runs from a checkout."""
    root = Path(semantic_slam.__file__).resolve().parents[1]  # a symlink install imports through build/
    if not (root / ".git").exists():
        return str(semantic_slam.__version__)
    command = ["git", "-C", str(root), "describe", "--always", "--dirty"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return str(semantic_slam.__version__)
    return f"{semantic_slam.__version__}+{found}"

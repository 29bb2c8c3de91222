"""``python -m semantic_slam_lab.documentation.set_up --out FILE``: what `make demo` takes from a fresh clone."""

import argparse
import json
import os
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.pipeline.provenance import machine

GB = 1e9
SET_BY_ENV_SH = (
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "VIRTUAL_ENV",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
)
"""What would lead the clone to this installation."""


def measure(checkout: Path) -> dict[str, str | float]:
    """Revision, minutes and GB of a clone of ``checkout``, set up and replayed once."""
    with TemporaryDirectory() as folder:
        clone = Path(folder) / "clone"
        subprocess.run(["git", "clone", "--quiet", str(checkout.resolve()), str(clone)], check=True)
        describe = ["git", "describe", "--always"]
        revision = subprocess.run(describe, cwd=clone, capture_output=True, text=True, check=True).stdout.strip()
        environment = {name: text for name, text in os.environ.items() if name not in SET_BY_ENV_SH}
        start = time.monotonic()
        subprocess.run(["make", "demo"], cwd=clone, env=environment, check=True)
        minutes = (time.monotonic() - start) / 60.0
        size = sum(path.lstat().st_size for path in clone.rglob("*"))
    return {"revision": revision, "minutes": minutes, "disk_gb": size / GB}


def command() -> None:
    """Measure and write; raises InputError."""
    parser = CommandParser(prog="documentation.set_up", description="Time `make demo` in a fresh clone.")
    parser.add_argument("--root", type=Path, default=Path(), help="the checkout to clone (default: here)")
    parser.add_argument("--out", type=Path, default=Path("out/set_up.json"), help="file (default: %(default)s)")
    arguments: argparse.Namespace = parser.parse_args()
    found = {"study": "set_up", "quick": False, "machine": machine(), **measure(arguments.root)}
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(arguments.out)


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()

"""``python -m semantic_slam_lab.fuzz --seconds 120 --seed 0``: the last line is ``N cases, M findings``.

``--live`` forges messages of a demo that runs: :mod:`semantic_slam_lab.fuzz.live`.
"""

import sys

from semantic_slam.cli.exit_codes import run_main
from semantic_slam_lab.fuzz.harness import parse, run
from semantic_slam_lab.fuzz.targets import TARGETS


def main() -> None:
    arguments = parse(TARGETS)
    if not arguments.live:
        sys.exit(run(TARGETS, arguments))
    from semantic_slam_lab.fuzz.live import run_live  # which needs ROS

    sys.exit(run_live(arguments))


run_main(main)

"""``python -m semantic_slam_lab.fuzz --seconds 120 --seed 0``: the last line is ``N cases, M findings``."""

import sys

from semantic_slam.cli.exit_codes import run_main
from semantic_slam_lab.fuzz.harness import parse, run
from semantic_slam_lab.fuzz.targets import TARGETS

run_main(lambda: sys.exit(run(TARGETS, parse(TARGETS))))

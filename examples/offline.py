"""Runs a bag without ROS and prints what is known of every object: python examples/offline.py BAG NEW_BELIEF_BAG"""

import argparse
from pathlib import Path

from semantic_slam import InputError, load_configuration, read_record, run_bag
from semantic_slam.pipeline.default_configuration import configuration_for

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("bag", type=Path, metavar="BAG")
arguments.add_argument("out", type=Path, metavar="NEW_BELIEF_BAG")
arguments.add_argument("--max-keyframes", type=int, metavar="N", help="end after the first N (default: the whole bag)")
given = arguments.parse_args()
try:
    settings = load_configuration(
        configuration_for(given.bag)
    )  # as semantic_slam report chooses it, or a file of yours
    summary = run_bag(given.bag, given.out, settings, max_keyframes=given.max_keyframes)
except InputError as fault:  # one line that names the remedy
    arguments.error(str(fault))
print(f"{summary.num_keyframes} keyframes, dropped: {summary.dropped}")
for known in read_record(summary.belief_bag).beliefs[-1].objects:
    print(known.name, {name: round(p, 3) for name, p in known.class_probabilities.items()})

"""Runs a bag without ROS and prints what is known of every object: python examples/offline.py BAG NEW_BELIEF_BAG"""

import sys
from pathlib import Path

from semantic_slam import load_configuration, read_record, run_bag

bag, out = Path(sys.argv[1]), Path(sys.argv[2])
summary = run_bag(bag, out, load_configuration(Path("config/default.yaml")), max_keyframes=5)
print(f"{summary.num_keyframes} keyframes, dropped: {summary.dropped}")
for known in read_record(summary.belief_bag).beliefs[-1].objects:
    print(known.name, {name: round(p, 3) for name, p in known.class_probabilities.items()})

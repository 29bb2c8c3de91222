"""Runs a bag without ROS and prints what is known of every object: python examples/offline.py BAG NEW_BELIEF_BAG"""

import sys
from pathlib import Path

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.pipeline.offline import run_bag

bag, out = Path(sys.argv[1]), Path(sys.argv[2])
summary = run_bag(bag, out, load_configuration(Path("config/default.yaml")), max_keyframes=5)
print(f"{summary.num_keyframes} keyframes, dropped: {summary.dropped}")
with BagReader(summary.belief_bag) as reader:
    for message in reader.messages([topics.BELIEF]):
        belief = from_message(reader.decode(message.cdr, message.type_name))
for name, classes in zip(belief.object_names, belief.class_probabilities, strict=True):
    print(name, dict(zip(belief.class_names, classes.round(3).tolist(), strict=True)))

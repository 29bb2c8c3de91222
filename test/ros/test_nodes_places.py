"""Nodes on a bag without pictures: the classifier passes places on, in lock-step with the others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bag_factory import of_topic, write_bag, write_configuration
from worlds.node_runs import Replay, assert_same, beliefs, run
from worlds.places import place_entries

from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.viewpoint.label_model import NONE_OF_THESE

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 10


def test_labels_give_the_names_of_the_offline_pipeline(tmp_path: Path) -> None:
    """Live the first detections name the classes, before which two frames show and name nothing."""
    entries = place_entries("ranges", NUM_FRAMES)
    for k, entry in enumerate(of_topic(entries, topics.DETECTIONS)):
        found = from_message(entry.message)
        labels = ("chair", "cup") if found.stamp_ns % 3 else ("cup", "cup")
        told = replace(found, labels=labels, class_names=("chair", "cup", "tv"))
        entry.message = to_message(told if k >= 2 else found.take(np.zeros(0, dtype=int)))
    settings = {"association": "open", "semantic_model": {"kind": "detector"}}
    configuration = write_configuration(tmp_path / "configuration", **settings)
    bag = write_bag(tmp_path / "bag", entries)
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    reference = beliefs(tmp_path / "offline")
    assert reference[-1].class_names == ("chair", "cup", "tv", NONE_OF_THESE)
    assert_same(run(Replay(bag, configuration, tmp_path / "live", backends=1)), reference)

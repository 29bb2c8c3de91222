"""Bags and runs whose detections carry vectors: two objects, each with its own look."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from worlds.bags.bag_factory import Entry, of_topic, write_bag, write_configuration

from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag

SIZE = 300
LOOKS = np.random.default_rng(0).normal(size=(2, SIZE))


def looking(entries: list[Entry], sigma: float = 0.3, looks: np.ndarray = LOOKS) -> list[Entry]:
    """The detections of every frame, which show the two objects in turn."""
    random = np.random.default_rng(1)
    for entry in of_topic(entries, topics.DETECTIONS):
        found = from_message(entry.message)
        vectors = looks[: len(found)] + random.normal(0.0, sigma, (len(found), looks.shape[1]))
        entry.message = to_message(replace(found, embeddings=vectors))
    return entries


def run(folder: Path, entries: list[Entry], prior=None, **changes: object) -> Path:
    """The belief bag of a run on a bag of these entries."""
    settings = {"perception": {"network": "nowhere.safetensors"}, "association": "open"}
    settings |= {"semantic_model": {"kind": "embedding"}} | changes
    configuration = write_configuration(folder / "configuration", **settings)
    done = run_bag(write_bag(folder / "bag", entries), folder / "belief", load_configuration(configuration), prior)
    if done.fault is not None:
        raise done.fault
    return folder / "belief"

"""Offline runs whose work a few processes share: one reads ahead and perceives, others weigh hypotheses."""

import os
from pathlib import Path

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration
from semantic_slam.inference.processes.process_pool import ProcessPool
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import RunSummary, run_bag

LONG = 200
"""Frames from which on another process is worth its start, which takes some two seconds."""


def run_shared(
    bag: Path,
    out_bag: Path,
    configuration: Configuration,
    map_prior: MapPrior | None = None,
    max_keyframes: int | None = None,
    processes: int | None = None,
) -> RunSummary:
    """:func:`run_bag` by as many processes, with the same beliefs.

    ``processes`` 1: this one alone; 2: another one reads ahead and perceives; more: the others share the hypotheses;
    None: 2 for a long bag where there are two cores, else 1. Raises InputError.
    """
    if processes is None:
        processes = 2 if _is_worthwhile(bag) else 1
    reads_ahead = processes > 1
    if processes <= 2:
        return run_bag(bag, out_bag, configuration, map_prior, max_keyframes, reads_ahead=reads_ahead)
    with ProcessPool(processes - 2) as pool:
        return run_bag(bag, out_bag, configuration, map_prior, max_keyframes, pool, reads_ahead=reads_ahead)


def _is_worthwhile(bag: Path) -> bool:
    if len(os.sched_getaffinity(0)) < 2:
        return False
    with BagReader(bag, announces=False) as reader:
        counts = reader.counts
    return max(counts[absolute(topic)] for topic in (topics.MEASUREMENTS, topics.DETECTIONS)) >= LONG

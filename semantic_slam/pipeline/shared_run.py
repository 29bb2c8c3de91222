"""Offline runs whose work a few processes share: one reads ahead and perceives, others weigh hypotheses."""

import os
from pathlib import Path

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
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
    None: 2 for a long run where there are two cores, else 1. Raises InputError.
    """
    if processes is None:
        is_long = max_keyframes is None or max_keyframes >= LONG
        processes = 2 if is_long and _is_worthwhile(bag) else 1
    if processes > 2 and configuration.history.horizon_keyframes:
        raise InputError(
            f"--processes {processes}: with history.horizon_keyframes hypotheses are not shared, as one that moves to"
            " another process would replay the drive; give 2 at most"
        )
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

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
"""Frames from which on other processes are worth their start, which takes each some two seconds."""


def run_shared(
    bag: Path,
    out_bag: Path,
    configuration: Configuration,
    map_prior: MapPrior | None = None,
    max_keyframes: int | None = None,
    backends: int | None = None,
) -> RunSummary:
    """:func:`run_bag` with as many processes of backends, and one that reads ahead; the same beliefs, bit for bit.

    ``backends`` 0: all in this process; None: 1 for a long bag where there are two cores, else 0. Raises InputError.
    """
    if backends is None:
        backends = _worthwhile(bag)
    if not backends:
        return run_bag(bag, out_bag, configuration, map_prior, max_keyframes)
    with ProcessPool(backends) as pool:
        return run_bag(bag, out_bag, configuration, map_prior, max_keyframes, pool, reads_ahead=True)


def _worthwhile(bag: Path) -> int:
    if len(os.sched_getaffinity(0)) < 2:
        return 0
    with BagReader(bag, announces=False) as reader:
        counts = reader.counts
    return int(max(counts[absolute(topic)] for topic in (topics.MEASUREMENTS, topics.DETECTIONS)) >= LONG)

"""What a long run costs by keyframe, and what it holds."""

import gc
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from tqdm import tqdm

from semantic_slam.configuration import Configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam_lab.soak.tour import Tour

EVERY = 100
"""Keyframes from one row to the next."""


Row = dict[str, float]
"""What is measured of :data:`EVERY` keyframes, by name."""


def soaked(configuration: Configuration, map_prior: MapPrior | None, num_keyframes: int, seed: int) -> Iterator[Row]:
    """Run the engine over the first keyframes of a tour; a row for every :data:`EVERY` of them, as it goes."""
    engine = Engine(configuration, map_prior)
    spent, errors, hypotheses = [], [], []
    tour = islice(Tour(configuration, seed).keyframes(), num_keyframes)
    for number, seen in enumerate(tqdm(tour, total=num_keyframes, unit="keyframe"), start=1):
        begin = time.process_time()
        belief = engine.process(seen.keyframe)
        spent.append(1e3 * (time.process_time() - begin))
        errors.append(float(np.hypot(*(belief.poses[0, :2] - seen.pose[:2]))))
        hypotheses.append(len(belief.hypothesis_ids))
        if number % EVERY == 0:
            yield {
                "keyframes": number,
                "cpu_ms": float(np.mean(spent)),
                "cpu_ms_median": float(np.median(spent)),
                "rss_mb": rss_mb(),
                "hypotheses": float(np.mean(hypotheses)),
                "objects": len(belief.object_ids),
                "error_m": float(np.mean(errors)),
                **held(engine),
            }
            spent, errors, hypotheses = [], [], []


def held(engine: Engine) -> dict[str, int]:
    """Counts of what an engine and its backend in this process hold: the same numbers in every run."""
    assert isinstance(engine.pool, InProcessPool)
    heaviest = engine.pool.component(next(iter(engine.live)))
    isam = heaviest.smoother.isam
    graph = isam.getFactorsUnsafe()
    return {
        "variables": int(isam.getLinearizationPoint().size()),
        "slots": int(graph.size()),
        "factors": int(graph.nrFactors()),
        "steps": engine.pool.num_steps_in_memory,
        "lineage": len(next(iter(engine.live.values())).lineage),
    }


def rss_mb() -> float:
    """Resident memory of this process, megabytes."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6

"""Many hypotheses on two backends against one, each backend a process; the manager speaks to them over pipes."""

import dataclasses
import json

import numpy as np

from semantic_slam.configuration import from_dict, to_dict
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.grid.hypothesis_fan import TRACKED
from semantic_slam_lab.grid.measured_pool import MeasuredPool
from semantic_slam_lab.grid.run import keyframes_of, run_of
from semantic_slam_lab.grid.world import World, grid_world

HYPOTHESES, DETECTIONS = 200, 3
WARM_UP = 3
"""Keyframes until so many hypotheses are there, and have found their backends."""
REPETITIONS, QUICK_REPETITIONS = 2, 1


def two_backends(quick: bool, seed: int) -> list[Row]:
    """Wall time of expand and commit, the two pools in turn on the same keyframes."""
    repetitions = QUICK_REPETITIONS if quick else REPETITIONS
    world = grid_world(seed, num_detections=DETECTIONS, num_keyframes=WARM_UP + repetitions, noise=TRACKED)
    run = many_hypotheses(world)
    times: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
    held = []
    with MeasuredPool(1) as one, MeasuredPool(2) as two:
        managers = {1: (Engine.of_run(run, one), one), 2: (Engine.of_run(run, two), two)}
        for index, keyframe in enumerate(keyframes_of(world)):
            for number, (manager, pool) in managers.items():
                before = pool.seconds, pool.busy_seconds
                held.append(len(manager.live))
                manager.process(keyframe)
                if index >= WARM_UP:
                    times[number].append((pool.seconds - before[0], pool.busy_seconds - before[1]))
    (single, busy), (double, shared) = (np.median(times[number], axis=0).tolist() for number in (1, 2))
    how = (
        f"expand and commit, wall time with the exchange between processes (pickles over sockets); at least"
        f" {min(held[2 * WARM_UP :])} hypotheses in, at most {HYPOTHESES} out, {DETECTIONS} detections of 6 objects;"
        " throughput of 2 backends over that of 1, each a process beside the manager's; CPU time of the slower backend:"
        f" {busy / shared:.2f} times less"
    )
    return [Row("two_backends_vs_one", double * 1e3, single * 1e3, "ms", single / double, repetitions, how)]


def many_hypotheses(world: World) -> RunConfiguration:
    """The world's run with ``HYPOTHESES`` kept, however unlikely."""
    run = run_of(world)
    settings = to_dict(from_dict(json.loads(run.configuration)))
    settings["pruning"] |= {"ratio": 1e12, "max_hypotheses": HYPOTHESES}
    return dataclasses.replace(run, configuration=json.dumps(settings, sort_keys=True))

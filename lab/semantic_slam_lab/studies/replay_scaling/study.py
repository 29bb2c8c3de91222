"""Replay of one drive in maps of 10, 100 and 1000 objects, through the manager with one and two backends.

A backend is a process of its own here, as it is a node of its own on a robot; the manager is the one of every run and
speaks to them over pipes. The replay starts from keyframes, so that neither images nor ROS are in the times.
"""

import time
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.configuration import Configuration, to_dict
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam_lab.grid.measured_pool import MeasuredPool
from semantic_slam_lab.grid.run import keyframes_of, run_of
from semantic_slam_lab.grid.world import Noise, World, grid_world
from semantic_slam_lab.studies.replay_scaling.page import claims_of, figure_of, table_of
from semantic_slam_lab.studies.result import write_result

NAME = "replay_scaling"
SHAPES = {10: (5, 2), 100: (10, 10), 1000: (40, 25)}
"""Objects -> rows and columns of their grid. The robot drives about its middle: what it sees of a map does not grow."""
QUICK_SIZES = (10, 100)
BACKENDS = (1, 2)
KEYFRAMES, QUICK_KEYFRAMES = 8, 2
LIMIT_S, QUICK_LIMIT_S = 70.0, 30.0
"""Longest replay; what it has not reached by then is left out and reported."""
DETECTIONS = 3
START = Noise(robot=(2.25, 2.25, 0.04))
"""Half the objects' distance: with look-alike objects, several places explain the first keyframes."""


@dataclass(frozen=True)
class Replay:
    """One map with one number of backends, K keyframes reached."""

    num_objects: int
    num_backends: int
    num_keyframes: int  # wanted
    seconds: list[float]  # (K,) wall time of the manager's call
    busy_seconds: list[float]  # (K,) CPU time of the backend that took longest in each round
    hypotheses: list[int]  # (K,) kept
    right: list[bool]  # (K,) the heaviest hypothesis's association is the true one
    peak_rss_mb: float | None  # of all backends; None where they were ended
    beliefs: list[HybridBelief]

    @property
    def finished(self) -> bool:
        """Whether all keyframes were reached in time."""
        return len(self.seconds) == self.num_keyframes


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Replay, compare, write; one replay at a time, whatever ``jobs``, for it is times that are measured."""
    count, limit_s = (QUICK_KEYFRAMES, QUICK_LIMIT_S) if quick else (KEYFRAMES, LIMIT_S)
    sizes = QUICK_SIZES if quick else tuple(SHAPES)
    cases = [(size, number) for size in sizes for number in BACKENDS]
    worlds = {size: world_of(size, count, seed) for size in sizes}
    replays = [replay(worlds[size], number, limit_s) for size, number in tqdm(cases, desc="replays")]
    out.mkdir(parents=True, exist_ok=True)
    rows = rows_of(replays)
    result = _result(rows, limit_s, quick, seed)
    return write_result(out, result, claims_of(rows), [table_of(rows)], [figure_of(out / "times.png", rows)])


def world_of(num_objects: int, num_keyframes: int, seed: int) -> World:
    """A map of that size and the drive through its middle."""
    shape = SHAPES[num_objects]
    return grid_world(
        seed, num_detections=DETECTIONS, num_keyframes=num_keyframes, shape=shape, aligned=True, noise=START
    )


def replay(world: World, num_backends: int, limit_s: float) -> Replay:
    """All keyframes of a world, or those that are done within ``limit_s`` seconds."""
    found = Replay(len(world.object_means), num_backends, len(world.frames), [], [], [], [], None, [])
    try:
        with MeasuredPool(num_backends, limit_s) as pool:
            manager = Engine.of_run(run_of(world), pool)
            for frame, keyframe in zip(world.frames, keyframes_of(world), strict=True):
                busy, start = pool.busy_seconds, time.perf_counter()
                belief = manager.process(keyframe)
                found.seconds.append(time.perf_counter() - start)
                found.busy_seconds.append(pool.busy_seconds - busy)
                found.hypotheses.append(len(belief.log_weights))
                found.right.append(_heaviest(belief) == frame.objects)
                found.beliefs.append(belief)
            memory = pool.resident_mb()
    except TimeoutError:
        return found
    return Replay(**{**_shallow(found), "peak_rss_mb": memory})


def _heaviest(belief: HybridBelief) -> tuple[int, ...]:
    indices = belief.associations[int(np.argmax(belief.log_weights))]
    return tuple(int(belief.object_ids[index]) for index in indices)


def _shallow(item: Any) -> dict[str, Any]:
    return {field.name: getattr(item, field.name) for field in fields(item)}


def rows_of(replays: list[Replay]) -> list[dict[str, Any]]:
    """A row of numbers per replay; None where there is none. The reference is one backend on the same map."""
    single = {item.num_objects: item for item in replays if item.num_backends == 1}
    return [_row(item, single[item.num_objects]) for item in replays]


def _row(item: Replay, single: Replay) -> dict[str, Any]:
    shared = min(len(item.beliefs), len(single.beliefs))
    pairs = zip(item.beliefs[:shared], single.beliefs[:shared], strict=True)
    return {
        "objects": item.num_objects,
        "backends": item.num_backends,
        "keyframes": len(item.seconds),
        "keyframes_wanted": item.num_keyframes,
        "finished": item.finished,
        "ms_per_keyframe_p50": _quantile(item.seconds, 0.5),
        "ms_per_keyframe_p95": _quantile(item.seconds, 0.95),
        "cpu_ms_per_keyframe_p50": _quantile(item.busy_seconds, 0.5),
        "speedup": _ratio(single.seconds[:shared], item.seconds[:shared]),
        "cpu_speedup": _ratio(single.busy_seconds[:shared], item.busy_seconds[:shared]),
        "hypotheses_mean": float(np.mean(item.hypotheses)) if item.hypotheses else None,
        "association_right": float(np.mean(item.right)) if item.right else None,
        "peak_rss_mb": item.peak_rss_mb,
        "keyframes_compared": shared,
        "belief_difference": max((belief_difference(a, b) for a, b in pairs), default=None),
    }


def belief_difference(first: HybridBelief, second: HybridBelief) -> float:
    """Largest difference of any number in two beliefs, where both are NaN none; inf where they differ in kind."""
    largest = 0.0
    for field in fields(HybridBelief):
        a, b = getattr(first, field.name), getattr(second, field.name)
        numbers = isinstance(a, float) or (isinstance(a, np.ndarray) and a.dtype.kind == "f")
        largest = max(largest, _difference(np.asarray(a), np.asarray(b), numbers))
    return largest


def _difference(a: NDArray[Any], b: NDArray[Any], numbers: bool) -> float:
    if not numbers or a.shape != b.shape or not np.array_equal(np.isnan(a), np.isnan(b)):
        return 0.0 if a.shape == b.shape and not numbers and np.array_equal(a, b) else np.inf
    return float(np.nanmax(np.abs(a - b), initial=0.0))


def _quantile(seconds: list[float], share: float) -> float | None:
    return 1e3 * float(np.quantile(seconds, share)) if seconds else None


def _ratio(single: list[float], mine: list[float]) -> float | None:
    return sum(single) / sum(mine) if mine else None


def _result(rows: list[dict[str, Any]], limit_s: float, quick: bool, seed: int) -> dict[str, Any]:
    from semantic_slam.pipeline.provenance import revision

    names = ("ms_per_keyframe_p50", "ms_per_keyframe_p95", "peak_rss_mb", "speedup", "association_right")
    return {
        "study": NAME,
        "seed": seed,
        "config": {
            **to_dict(Configuration()),
            "study": {
                "limit_s": limit_s,
                "detections": DETECTIONS,
                "robot_variances": START.robot,
                "model_and_visibility": "those of chapter 4's world",
            },
        },
        "revision": revision(),
        "quick": quick,
        "methods": {
            "ours": {
                "method": "default configuration, backends as processes",
                **{
                    f"{name}_{row['objects']}_objects_{row['backends']}_backends": row[name]
                    for row in rows
                    for name in names
                },
            }
        },
        "replays": rows,
    }

"""Time per keyframe against keyframes, objects, detections and hypotheses: exponents of fitted powers."""

from collections.abc import Sequence

import numpy as np

from semantic_slam_lab.benchmarks.row import Row, cpu_seconds
from semantic_slam_lab.grid.hypothesis_fan import TRACKED, HypothesisFan
from semantic_slam_lab.grid.world import grid_world

DETECTIONS, HYPOTHESES = 2, 1
REPETITIONS = 3
"""Keyframes that a median is taken over."""
WIDENING = 2
"""Keyframes that it takes until all hypotheses are there."""
LENGTHS, QUICK_LENGTHS = (10, 20, 40, 80), (5, 10, 20)
SHAPES, QUICK_SHAPES = ((3, 2), (6, 4), (9, 6)), ((3, 2), (6, 4))
FRAME_SIZES, QUICK_FRAME_SIZES = (1, 2, 3, 4), (1, 2, 3)
FANS, QUICK_FANS = (1, 4, 16, 64), (1, 4, 16)


def growth(quick: bool, seed: int) -> list[Row]:
    """One row each; ``ours`` is the time at the largest size."""
    lengths, shapes = (QUICK_LENGTHS, QUICK_SHAPES) if quick else (LENGTHS, SHAPES)
    frames, fans = (QUICK_FRAME_SIZES, QUICK_FANS) if quick else (FRAME_SIZES, FANS)
    setting = f"{HYPOTHESES} hypothesis, 6 objects, {DETECTIONS} detections unless that is what grows"
    return [
        _row("keyframes", lengths, along_track(seed, lengths), setting),
        _row("objects", [a * b for a, b in shapes], [keyframe_seconds(seed, shape=shape) for shape in shapes], setting),
        _row("detections", frames, [keyframe_seconds(seed, detections=n) for n in frames], setting),
        _row("hypotheses", fans, [keyframe_seconds(seed, hypotheses=n, detections=3) for n in fans], setting),
    ]


def along_track(seed: int, lengths: Sequence[int]) -> list[float]:
    """Seconds per keyframe around the given lengths of one track."""
    world = grid_world(seed, num_detections=DETECTIONS, num_keyframes=max(lengths) + REPETITIONS, noise=TRACKED)
    fan = HypothesisFan(world, HYPOTHESES)
    seconds = [cpu_seconds(fan.step) for _ in world.frames]
    return [float(np.median(seconds[n : n + REPETITIONS])) for n in lengths]


def keyframe_seconds(
    seed: int, *, shape: tuple[int, int] = (3, 2), detections: int = DETECTIONS, hypotheses: int = HYPOTHESES
) -> float:
    """Seconds per keyframe of a short track."""
    count = WIDENING + REPETITIONS
    world = grid_world(seed, num_detections=detections, num_keyframes=count, shape=shape, noise=TRACKED)
    fan = HypothesisFan(world, hypotheses)
    fan.advance(WIDENING)
    return float(np.median([cpu_seconds(fan.step) for _ in range(REPETITIONS)]))


def _row(name: str, sizes: Sequence[int], seconds: Sequence[float], setting: str) -> Row:
    exponent = float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
    listed = ", ".join(f"{size}: {value:.3g} s" for size, value in zip(sizes, seconds, strict=True))
    how = f"expand and commit of one keyframe; {setting}; {listed}; ours: the last; ratio: exponent of the fit"
    return Row(f"keyframe_growth_{name}", seconds[-1], float("nan"), "s", exponent, REPETITIONS, how)

"""Worlds drawn from the priors of ``config/uncalibrated.yaml``: is the belief calibrated; and if a prior is wrong?"""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration, load_configuration, to_dict
from semantic_slam.geometry.arrays import Array
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.drawn_worlds.calibration import p_values, rejected, reliability
from semantic_slam_lab.studies.drawn_worlds.pages import claims_of, figures_of, tables_of
from semantic_slam_lab.studies.drawn_worlds.ranks import Outcome, outcome_of
from semantic_slam_lab.studies.drawn_worlds.truths import RIGHT, TRUTHS
from semantic_slam_lab.studies.drawn_worlds.worlds import drawn_world
from semantic_slam_lab.studies.result import write_result

NAME = "drawn_worlds"
WORLDS, QUICK_WORLDS = 300, 2
WRONG_WORLDS, QUICK_WRONG_WORLDS = 40, 1
KEYFRAMES, QUICK_KEYFRAMES = 20, 3


def configuration() -> Configuration:
    """``config/uncalibrated.yaml``, every keyframe being given."""
    base = load_configuration(configuration_file("uncalibrated"))
    return replace(base, keyframes=replace(base.keyframes, policy="every_detection"))


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Draw, run, compare; returns the files written."""
    num_keyframes = QUICK_KEYFRAMES if quick else KEYFRAMES
    counts = (QUICK_WORLDS, QUICK_WRONG_WORLDS) if quick else (WORLDS, WRONG_WORLDS)
    tasks = [
        (truth, number, num_keyframes, seed)
        for truth in TRUTHS
        for number in range(counts[0] if truth == RIGHT else counts[1])
    ]
    outcomes = repeat(one_world, tasks, jobs, "worlds")
    found: dict[str, list[Outcome]] = defaultdict(list)
    for (truth, *_), outcome in zip(tasks, outcomes, strict=True):
        found[truth].append(outcome)
    return _written(out, found, quick, seed)


def one_world(truth: str, number: int, num_keyframes: int, seed: int) -> Outcome:
    """Draw a world and run it."""
    world = drawn_world(configuration(), num_keyframes, keyed_generator(NAME, truth, number, seed), TRUTHS[truth])
    return outcome_of(configuration(), world, keyed_generator(NAME, truth, number, seed, "draws"))


def _written(out: Path, found: dict[str, list[Outcome]], quick: bool, seed: int) -> list[Path]:
    from semantic_slam.pipeline.provenance import revision

    result = {
        "study": NAME,
        "seed": seed,
        "config": to_dict(configuration()),
        "revision": revision(),
        "quick": quick,
        "num_worlds": {truth: len(outcomes) for truth, outcomes in found.items()},
        "region95_held": {truth: float(np.mean(_held(outcomes))) for truth, outcomes in found.items()},
        "region95_held_sigma": {truth: _sigma(_held(outcomes)) for truth, outcomes in found.items()},
        **_calibration(found[RIGHT], seed),
    }
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims_of(result), tables_of(result), figures_of(out, result))


def _held(outcomes: list[Outcome]) -> Array:
    """(N,) of each world, the share of its keyframes."""
    return np.array([own.held for own in outcomes])


def _sigma(shares: Array) -> float:
    """Standard error of the mean of (N,) shares of independent worlds; 1 where a single one tells nothing of it."""
    return float(shares.std(ddof=1) / np.sqrt(len(shares))) if len(shares) > 1 else 1.0


def _calibration(outcomes: list[Outcome], seed: int) -> dict[str, Any]:
    """Ranks and stated probabilities of all worlds whose priors are as stated."""
    ties = keyed_generator(NAME, "ties", seed)
    ranks: dict[str, list[float]] = defaultdict(list)
    stated: dict[str, list[tuple[float, bool]]] = defaultdict(list)
    for outcome in outcomes:
        for name, rank in outcome.ranks.items():
            ranks[name].append(rank)
        for name, own in outcome.stated.items():
            ranks[name].append(own.rank(ties))
            stated[name].append((own.probability, own.holds))
    values = p_values(ranks)
    return {
        "ranks": dict(ranks),
        "p_values": values,
        "rejected": rejected(values),
        "reliability": {name: reliability(*np.array(pairs).T) for name, pairs in stated.items()},
    }

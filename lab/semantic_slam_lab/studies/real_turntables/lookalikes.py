"""Which objects look alike to the trunk, and draws of five with such a pair in each."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.real_turntables.photographs import Photographs

NUM_CLASSES = 5
PAIRS = 10
"""The most alike pairs, that draws take by turns."""


@dataclass(frozen=True)
class Pair:
    """Two objects and the cosine of the trunk's features of their most alike views."""

    names: tuple[str, str]
    similarity: float


@dataclass(frozen=True)
class Draw:
    """Five objects; the first two look alike."""

    number: int
    names: tuple[str, ...]


def lookalike_pairs(photographs: Photographs, pooled: Array) -> list[Pair]:
    """The most alike pairs of different objects, the most alike first; fewer where objects are few."""
    unit = pooled / np.linalg.norm(pooled, axis=1, keepdims=True)
    rows = {name: unit[photographs.of(name)] for name in photographs.names}
    pairs = [Pair((a, b), float((rows[a] @ rows[b].T).max())) for a, b in combinations(photographs.names, 2)]
    return sorted(pairs, key=lambda pair: -pair.similarity)[:PAIRS]


def drawn(photographs: Photographs, pairs: list[Pair], count: int, seed: int) -> list[Draw]:
    """``count`` draws: a pair by turns, and three other objects by lot."""
    draws = []
    for number in range(count):
        pair = pairs[number % len(pairs)].names
        others = [name for name in photographs.names if name not in pair]
        generator = keyed_generator("real_turntables", "draw", seed, number)
        chosen = generator.choice(others, NUM_CLASSES - 2, replace=False)
        draws.append(Draw(number, (*pair, *(str(name) for name in chosen))))
    return draws

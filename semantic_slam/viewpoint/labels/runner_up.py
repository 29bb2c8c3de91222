"""Likelihood of second-best words: a detector with a wrong first word often ranks the true one second.

Given the first word a, the second word b of an object of class c is either drawn anew, or repeats that of the nearest
earlier view with the same first word. New ones are drawn from the object's earlier second words, or from its class
(Polya's urn, as for first words):

    P(b | a, c) = tau [b = c] + (1 - tau) / (W - 2) [b != c], where a is wrong; any word alike, where it is right.

How often the truth is second, how strongly second words repeat, and how object-specific they are is one of H habits of
an object, equally likely before any fit; in some, the truth is second no more often than any word. Likelihoods are
relative to a uniform word, so that a view without a second word contributes nothing.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array

TRUTH_SHARES = (0.0, 0.3, 0.6)
"""Values of tau: how often the truth is second where the first word is wrong, beyond chance."""
REPEAT_SHARES, REPEAT_RAD = (0.0, 0.95), 0.5
"""Probabilities that a second word repeats at the same viewpoint, and the angle over which they decay by 1 / e."""
COUNTS = (1.0, 10.0)
"""Values of the class prior's pseudo-count, in views."""
LEAST_WORDS = 3
"""Smallest number of words at which a second word is informative."""
NONE = -1
"""Marks that there is no second word."""
HABITS = np.array(list(product(TRUTH_SHARES, REPEAT_SHARES, COUNTS))).T
"""(3, H) all combinations of truth share, repeat share and count."""
EVEN_HABITS = np.full(HABITS.shape[1], 1.0 / HABITS.shape[1])
"""(H,) uniform prior of the habits, before any fit."""
RIGHT, TRUTH, NEITHER = 0, 1, 2
"""Relation of a class to a view: it is the first word, the second word, or neither."""


@dataclass(frozen=True, kw_only=True)
class RunnerUp:
    """A view's two best words, and the second word of the nearest earlier view with the same first word."""

    first: int
    second: int
    earlier: int  # NONE where there is none
    away: float  # angle to that view, or change of log distance


@dataclass(frozen=True, kw_only=True)
class RunnersUp:
    """Second-word statistics of an object; H habits, C = W classes, the last being "none of the labels"."""

    habits: Array  # (C, H) probabilities of the habits, given the class
    counts: Array  # (W, H) of words that were drawn anew
    total: Array  # (H,) of them

    @classmethod
    def start(cls, num_words: int, habits: Array) -> Self:
        """Empty statistics; ``habits`` (H,) is the prior of the habits."""
        return cls(
            habits=np.repeat(habits[None], num_words, axis=0),
            counts=np.zeros((num_words, len(habits))),
            total=np.zeros(len(habits)),
        )

    def following(self, seen: RunnerUp) -> "NextSecond | None":
        """Evidence of one more view; None where it has no second word."""
        size = len(self.counts)
        if seen.second == NONE or size < LEAST_WORDS:
            return None
        views, before = _expected(size)
        found = (before + self.counts[seen.second]) / (views + self.total - self.counts[seen.first])
        new: Array | float = 1.0
        if seen.earlier != NONE:
            repeating = HABITS[1] * np.exp(-seen.away / REPEAT_RAD)
            anew = (1.0 - repeating) * found
            found = anew + repeating * (seen.earlier == seen.second)
            new = anew[NEITHER] / found[NEITHER]
        joint = self.habits * found[NEITHER]
        for row, kind in ((seen.second, TRUTH), (seen.first, RIGHT), (-1, RIGHT)):
            joint[row] = self.habits[row] * found[kind]
        return NextSecond(before=self, second=seen.second, new=new, joint=joint, likelihood=joint.sum(axis=1))


@dataclass(frozen=True, kw_only=True)
class NextSecond:
    """Evidence and update of one more view's second word."""

    before: RunnersUp
    second: int
    new: Array | float  # (H,) probability that the word is drawn anew
    joint: Array  # (C, H) joint probability of word and habits
    likelihood: Array  # (C,)

    @property
    def gained(self) -> Array:
        """(C,) log likelihood relative to a uniformly drawn word."""
        return np.asarray(np.log(self.likelihood * (len(self.likelihood) - 1)))

    @property
    def after(self) -> RunnersUp:
        """Statistics of the object including this view."""
        counts = self.before.counts.copy()
        counts[self.second] += self.new
        return RunnersUp(
            habits=self.joint / self.likelihood[:, None], counts=counts, total=self.before.total + self.new
        )


def first_gains(num_words: int, habits: Array) -> Array:
    """(3,) log likelihood of a first view's second word per relation (RIGHT, TRUTH, NEITHER), relative to uniform."""
    views, expected = _expected(num_words)
    return np.asarray(np.log((habits * (expected / views)).sum(axis=1) * (num_words - 1)))


@cache
def _expected(num_words: int) -> tuple[Array, Array]:
    """(H,) pseudo-counts of the class prior, and (3, H) its expected counts of a second word per relation."""
    chance, truth = 1.0 / (num_words - 1), truth_second(num_words)
    return HABITS[2], HABITS[2] * np.array([np.full(len(truth), chance), truth, (1.0 - truth) / (num_words - 2)])


def truth_second(num_words: int) -> Array:
    """(H,) probability that the truth is second where the first of W words is wrong, chance included."""
    chance = 1.0 / (num_words - 1)
    return np.asarray(chance + (1.0 - chance) * HABITS[0])

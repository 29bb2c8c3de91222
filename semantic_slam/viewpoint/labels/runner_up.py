"""What the second word of each view tells of an object's class: a detector that is wrong often has the truth second.

Given its first word a, the second word b of an object of class c is drawn anew, or repeats that of the nearest earlier
view with the same first word. New ones are drawn from words that the object has had second before, or from its class
(Polya's urn, as first words are):

    P(b | a, c) = tau [b = c] + (1 - tau) / (W - 2) [b != c], where a is wrong; any word alike, where it is right.

How often the truth is second, how far second words repeat and how far each object has some of its own is one of several
habits of an object, all as likely before any fit; some have the truth second no oftener than any word. What is told is
relative to any word alike, so that a view without a second word tells nothing.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array

TRUTH_SHARES = (0.0, 0.3, 0.6)
"""How often the truth is second where the first word is wrong, beyond what chance has there."""
REPEAT_SHARES, REPEAT_RAD = (0.0, 0.95), 0.5
"""How often a second word from the same place is that of before, and the turn after which that is 1 / e as often."""
COUNTS = (1.0, 10.0)
"""Views that what is expected of a class counts as."""
LEAST_WORDS = 3
"""Words from which on a second one tells something."""
NONE = -1
"""There is no second word."""
HABITS = np.array(list(product(TRUTH_SHARES, REPEAT_SHARES, COUNTS))).T
"""(3, H) every combination."""
EVEN_HABITS = np.full(HABITS.shape[1], 1.0 / HABITS.shape[1])
"""(H,) before any fit."""
RIGHT, TRUTH, NEITHER = 0, 1, 2
"""What a class is to a view: its first word, its second one, or none of them."""


@dataclass(frozen=True, kw_only=True)
class RunnerUp:
    """A view's two best words, and the second one of the nearest earlier view with the same first one."""

    first: int
    second: int
    earlier: int  # NONE where there is none
    away: float  # turn to that view, or change of the logarithm of the distance


@dataclass(frozen=True, kw_only=True)
class RunnersUp:
    """The second words of an object so far; H habits, C = W classes of which the last is none of the labels."""

    habits: Array  # (C, H) probabilities of the habits, of an object of each class
    counts: Array  # (W, H) of words that were drawn anew
    total: Array  # (H,) of them

    @classmethod
    def start(cls, num_words: int, habits: Array) -> Self:
        """Nothing seen yet; ``habits`` (H,) are how many objects have each."""
        return cls(
            habits=np.repeat(habits[None], num_words, axis=0),
            counts=np.zeros((num_words, len(habits))),
            total=np.zeros(len(habits)),
        )

    def following(self, seen: RunnerUp) -> "NextSecond | None":
        """What one more view tells; None where it has no second word."""
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
    """The second word of one more view."""

    before: RunnersUp
    second: int
    new: Array | float  # (H,) probability that it is drawn anew
    joint: Array  # (C, H) of word and habits
    likelihood: Array  # (C,)

    @property
    def gained(self) -> Array:
        """(C,) log likelihood, relative to any word alike."""
        return np.asarray(np.log(self.likelihood * (len(self.likelihood) - 1)))

    @property
    def after(self) -> RunnersUp:
        """What is known of the object with it."""
        counts = self.before.counts.copy()
        counts[self.second] += self.new
        return RunnersUp(
            habits=self.joint / self.likelihood[:, None], counts=counts, total=self.before.total + self.new
        )


def first_gains(num_words: int, habits: Array) -> Array:
    """(3,) log likelihood of a first view's second word by what its class is to it, relative to any word alike."""
    views, expected = _expected(num_words)
    return np.asarray(np.log((habits * (expected / views)).sum(axis=1) * (num_words - 1)))


@cache
def _expected(num_words: int) -> tuple[Array, Array]:
    """(H,) views that what is expected counts as, and (3, H) those of a second word: by what its class is to a view."""
    chance, truth = 1.0 / (num_words - 1), truth_second(num_words)
    return HABITS[2], HABITS[2] * np.array([np.full(len(truth), chance), truth, (1.0 - truth) / (num_words - 2)])


def truth_second(num_words: int) -> Array:
    """(H,) how often the truth is second where the first of W words is wrong, by chance and beyond it."""
    chance = 1.0 / (num_words - 1)
    return np.asarray(chance + (1.0 - chance) * HABITS[0])

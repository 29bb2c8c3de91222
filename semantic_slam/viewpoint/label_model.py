"""What a detector's words tell of an object's class, before anybody has counted what it confuses.

An object of class c is called by a row of probabilities theta_c over words, which nobody knows: Dirichlet, with most of
its counts on the class's own label and the rest spread evenly. An object that none of the labels means is either called
otherwise, too, or by any label alike. Words count one after the other (Polya's urn), for each object by itself.

Views repeat themselves. From the place of an earlier view the detector repeats that answer with a probability rho,
whatever the object is, and else answers anew; rho decreases by 1 / e with every ``repeat_rad`` by which the direction
of view or the logarithm of the distance differ. Of the answers that are new a share e are outliers, any word alike:

    P(word | c, earlier) = rho [word = that of the nearest earlier view] + (1 - rho) ((1 - e) theta_c(word) + e / W).

Scores say how sure an answer is: q(w), in place of [w = word], in sum_w theta_c(w) q(w). They are densities relative to
that of scores under any class.

How large rho is from the same place, whether scores tell more than the word, and how many counts a row has (few: each
object is confused in a way of its own; many: any box may be confused) is decided by evidence, in settings that are as
likely before the first view: by that of all objects, for the detector is one.

Given theta the recursion is exact, and given which answers are new and what they mean so are the counts. Together they
are not: an answer counts by the probability that it is new and means the word (assumed-density filtering).
"""

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.perception.class_names import NONE_OF_THESE as NONE_OF_THESE

HIDDEN_NONE = 2
"""Rows that are this class: called by other words, and by any word."""
DIRECTIONS = 72
"""Cells around an object: the newest view from each is remembered."""
STEP_RAD = 2.0 * np.pi / DIRECTIONS
LEAST_REPORTED = 1.0 + 1e-9
"""Scores above the least by this factor were reported; the others share evenly what these leave."""


@dataclass(frozen=True, kw_only=True)
class LabelRecord:
    """The words of one object so far; R settings, K rows (the classes, and what none of these may be), N words."""

    log_likelihood: Array  # (R, K) of all views
    words: tuple[int, ...]  # N that were reported
    counts: Array  # (R, K, N) of new answers
    answers: Index  # (DIRECTIONS,) the newest word seen from each direction, -1: never seen from there
    log_ranges: Array  # (DIRECTIONS,) of the distances to these views, metres


@dataclass(frozen=True, kw_only=True)
class _Settings:
    """R ways that the detector may have."""

    repeat_shares: Array  # (R, 1) rho from the same place
    by_score: Array  # (R, 1) 1 where scores count besides the word, else 0
    factors: Array  # (R, 1, 1) on the Dirichlet counts of each row before any view


@dataclass(frozen=True, kw_only=True)
class LabelModel:
    """P(words of an object | class), the confusion of its class integrated out; L labels, W = L + 1 words."""

    labels: tuple[str, ...]  # L, all different
    accuracy: float  # expected probability of a class's own label
    counts: float  # views that this expectation counts as
    outlier_share: float  # e
    repeat_shares: tuple[float, ...]  # rho from the same place
    repeat_rad: float
    count_factors: tuple[float, ...] = (1.0,)  # on ``counts``

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) the labels, and none of these."""
        return (*self.labels, NONE_OF_THESE)

    @property
    def num_words(self) -> int:
        """W, with the word that stands for any other label."""
        return len(self.labels) + 1

    @cached_property
    def prior(self) -> Array:
        """(K, W) Dirichlet counts of each row before any view."""
        size = self.num_words
        spread = np.full((size, size), (1.0 - self.accuracy) / max(size - 1, 1))
        np.fill_diagonal(spread, self.accuracy)
        return np.asarray(self.counts * np.vstack([spread, np.full((1, size), 1.0 / size)]))

    @cached_property
    def _settings(self) -> "_Settings":
        every = itertools.product(self.count_factors, (0.0, 1.0), self.repeat_shares)
        factors, by_score, shares = np.array(list(every)).T
        return _Settings(
            repeat_shares=shares[:, None],
            by_score=by_score[:, None],
            factors=factors[:, None, None],
        )

    def start(self) -> LabelRecord:
        """Nothing seen yet."""
        size = (self.num_settings, len(self.prior))
        return LabelRecord(
            log_likelihood=np.zeros(size),
            words=(),
            counts=np.zeros((*size, 0)),
            answers=np.full(DIRECTIONS, -1),
            log_ranges=np.zeros(DIRECTIONS),
        )

    def after(self, record: LabelRecord, answer: int, shares: Array, direction: int, log_range: float) -> LabelRecord:
        """With one more view: its word (-1: none) with the (W,) scores of all, from a cell and a log distance."""
        if answer < 0:
            return replace(record, log_likelihood=record.log_likelihood - np.log(self.num_words))
        reported = {answer, *np.flatnonzero(shares > shares.min() * LEAST_REPORTED).tolist()}
        words = tuple(dict.fromkeys((*record.words, *sorted(reported))))
        repeating, repeated = self._repeats(record, answer, direction, log_range)  # (R, 1), 0 or 1
        before, meant, rest = self._meant(record, words, self._weights(answer, shares))
        new = meant.sum(axis=2) + rest  # (R, K)
        inlier = (1.0 - repeating) * (1.0 - self.outlier_share) * new
        outlier = (1.0 - repeating) * self.outlier_share / self.num_words
        likelihood = repeated * repeating + outlier + inlier
        added = meant * np.isin(words, list(reported)) * (inlier / (likelihood * new))[..., None]
        answers, log_ranges = record.answers.copy(), record.log_ranges.copy()
        answers[direction], log_ranges[direction] = answer, log_range
        return LabelRecord(
            log_likelihood=record.log_likelihood + np.log(likelihood),
            words=words,
            counts=before + added,
            answers=answers,
            log_ranges=log_ranges,
        )

    @property
    def num_settings(self) -> int:
        """R, of which the detector has one."""
        return len(self._settings.repeat_shares)

    def by_setting(self, record: LabelRecord) -> Array:
        """(R, C) log likelihood of all views under each setting, over what none of these may be."""
        told = record.log_likelihood
        none = finite_log_sum_exp(told[:, -HIDDEN_NONE:], axis=1) - np.log(HIDDEN_NONE)
        return np.column_stack([told[:, :-HIDDEN_NONE], none])

    def class_log_likelihood(self, record: LabelRecord) -> Array:
        """(C,) log likelihood of all views, where nothing else tells which setting is right."""
        return np.asarray(finite_log_sum_exp(self.by_setting(record), axis=0) - np.log(self.num_settings))

    def _weights(self, answer: int, shares: Array) -> Array:
        """(R, W) how far each word is meant: the answer alone, or as the scores have it."""
        by_score = self._settings.by_score
        return np.asarray(by_score * shares + (1.0 - by_score) * (np.arange(self.num_words) == answer))

    def _repeats(self, record: LabelRecord, answer: int, direction: int, log_range: float) -> tuple[Array, float]:
        """(R, 1) probabilities that the nearest earlier view is repeated, and 1 if its word is the answer, else 0."""
        seen = np.flatnonzero(record.answers >= 0)
        if not len(seen):
            return np.zeros_like(self._settings.repeat_shares), 0.0
        turns = np.abs(seen - direction)
        turned = STEP_RAD * np.minimum(turns, DIRECTIONS - turns)
        away = np.hypot(turned, record.log_ranges[seen] - log_range)
        nearest = int(np.argmin(away))
        share = self._settings.repeat_shares * np.exp(-away[nearest] / self.repeat_rad)
        return share, float(record.answers[seen[nearest]] == answer)

    def _meant(self, record: LabelRecord, words: tuple[int, ...], weights: Array) -> tuple[Array, Array, Array]:
        """Counts (R, K, N) of ``words`` before a view, q(w) E[theta_c(w)] of each, and (R, K) that of all others."""
        counts = np.zeros((*record.counts.shape[:2], len(words)))
        counts[..., : len(record.words)] = record.counts
        known, factors = np.array(words), self._settings.factors
        total = factors[..., 0] * self.prior.sum(axis=1) + counts.sum(axis=2)  # (R, K)
        own = self.prior[:, known]
        meant = (factors * own + counts) / total[..., None] * weights[:, None, known]
        others = np.maximum(weights @ self.prior.T - weights[:, known] @ own.T, 0.0)  # none left: rounding may go below
        return counts, meant, factors[..., 0] * others / total

"""Weighing one more view of an object: its likelihood, and the updated record, computed only when needed.

Most views are weighed against several objects but kept for few of them.
"""

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.labels.prior import LabelPrior
from semantic_slam.viewpoint.labels.record import LabelRecord, LabelView, ViewShares
from semantic_slam.viewpoint.labels.runner_up import NEITHER, NONE, RIGHT, TRUTH, NextSecond, RunnerUp


class WeighedView(Protocol):
    """A view of an object under each of R settings and K rows."""

    def log_evidence(self, log_rows: Array) -> Array:
        """(R,) log evidence of all views so far, summed over the rows with their (K,) log prior."""

    @property
    def by_setting(self) -> Array:
        """(R, C) log likelihood of all views so far, per setting and class."""

    @property
    def record(self) -> LabelRecord:
        """Record of all views, including this one."""


@dataclass(frozen=True, kw_only=True)
class SilentView:
    """A view without a label word."""

    prior: LabelPrior
    record: LabelRecord

    @classmethod
    def of(cls, prior: LabelPrior, record: LabelRecord) -> Self:
        """Weigh it as a uniformly distributed word, whatever the object."""
        return cls(prior=prior, record=replace(record, log_likelihood=record.log_likelihood - np.log(prior.num_words)))

    def log_evidence(self, log_rows: Array) -> Array:
        """(R,) sums over the rows."""
        return finite_log_sum_exp(self.record.log_likelihood + log_rows, axis=1)

    @property
    def by_setting(self) -> Array:
        """(R, C) log likelihood of each class."""
        return self.prior.by_class(self.record.log_likelihood)


@dataclass(frozen=True, kw_only=True)
class FirstView:
    """First word of an object: no earlier word can repeat, and the total count of a row cancels.

    Settings therefore differ only in how scores count: axis 0 of the arrays is that of the Q powers of scores.
    """

    prior: LabelPrior
    before: LabelRecord
    view: LabelView
    totals: Array  # (K,) counts of each row
    likelihood: Array  # (Q, K) of the word
    log_likelihood: Array  # (Q, K) of all views

    @classmethod
    def of(cls, prior: LabelPrior, record: LabelRecord, view: LabelView, drawn: Array) -> Self:
        """Weigh a view of an object without words; ``drawn`` (Q, K) as :meth:`LabelPrior.drawn` finds it."""
        totals, share = prior.totals[view.stretch][prior.sector_of(view)], prior.confusions[view.stretch].outlier_share
        likelihood = (1.0 - share) * (drawn / totals) + share / prior.num_words
        told = record.log_likelihood[0] + np.log(likelihood)  # any setting will do: all are equal so far
        if view.word.second != NONE:
            told[prior.is_by_word] += _first_gained(prior, view)  # scores include it already
        return cls(prior=prior, before=record, view=view, totals=totals, likelihood=likelihood, log_likelihood=told)

    def log_evidence(self, log_rows: Array) -> Array:
        """(R,) sums over the rows."""
        return finite_log_sum_exp(self.log_likelihood + log_rows, axis=1)[self.prior.power_of]

    @property
    def by_setting(self) -> Array:
        """(R, C) log likelihood of each class."""
        return self.prior.by_class(self.log_likelihood)[self.prior.power_of]

    @property
    def record(self) -> LabelRecord:
        """Record with the object's first words."""
        view, before, power_of = self.view, self.before, self.prior.power_of
        word, share = view.word, self.prior.confusions[view.stretch].outlier_share
        words, new = list(word.reported), (1.0 - share) / (self.totals * self.likelihood)
        meant = word.meant(words, self.prior.powers)  # (Q, N)
        counts = (self.prior.prior_of(view).T[words, None] * meant.T[..., None]) * new
        second = before.seconds.following(RunnerUp(first=word.answer, second=word.second, earlier=NONE, away=0.0))
        return LabelRecord(
            log_likelihood=self.log_likelihood[power_of],
            words=word.reported,
            counts=counts[:, power_of],
            newest=before.newest.following(view),
            seconds=before.seconds if second is None else second.after,
        )


@dataclass(frozen=True, kw_only=True)
class LaterView:
    """One more word of an object that already has words."""

    prior: LabelPrior
    before: LabelRecord
    view: LabelView
    totals: Array  # (R, K) counts of each row
    anew: Array  # (R, 1) probability that no earlier view is repeated
    inlier: Array  # (R, K) likelihood of the word as new and an inlier
    likelihood: Array  # (R, K) of the word
    log_likelihood: Array  # (R, K) of all views
    second: NextSecond | None

    @classmethod
    def of(cls, prior: LabelPrior, record: LabelRecord, view: LabelView, drawn: Array) -> Self:
        """Weigh a view of an object with words or without; ``drawn`` (Q, K) as :meth:`LabelPrior.drawn` finds it."""
        word, share, nearest = view.word, prior.confusions[view.stretch].outlier_share, record.newest.nearest(view)
        totals = prior.weighted_totals[view.stretch][prior.sector_of(view)] + record.counts.sum(axis=0)
        of_class, weights = prior.factors * drawn[prior.power_of], _weights(prior, record.words, view)
        new = (of_class + np.einsum("rn,nrk->rk", weights, record.counts)) / totals
        repeating = prior.repeats(nearest)
        anew = 1.0 - repeating
        inlier, outlier = (anew * (1.0 - share)) * new, anew * (share / prior.num_words)
        likelihood = inlier + (outlier + repeating if nearest.answer == word.answer else outlier)
        told = record.log_likelihood + np.log(likelihood)
        second = record.seconds.following(nearest.repeated_by(view))
        if second is not None:  # scores include it already, where they count
            told += prior.by_word * second.gained[prior.classes_of_rows]
        return cls(
            prior=prior,
            before=record,
            view=view,
            totals=totals,
            anew=anew,
            inlier=inlier,
            likelihood=likelihood,
            log_likelihood=told,
            second=second,
        )

    def log_evidence(self, log_rows: Array) -> Array:
        """(R,) sums over the rows."""
        return finite_log_sum_exp(self.log_likelihood + log_rows, axis=1)

    @property
    def by_setting(self) -> Array:
        """(R, C) log likelihood of each class."""
        return self.prior.by_class(self.log_likelihood)

    @property
    def record(self) -> LabelRecord:
        """Record with all words."""
        shares = self.shares
        return LabelRecord(
            log_likelihood=self.log_likelihood,
            words=shares.words,
            counts=shares.after,
            newest=self.before.newest.following(self.view),
            seconds=self.before.seconds if self.second is None else self.second.after,
        )

    @property
    def shares(self) -> ViewShares:
        """Posterior decomposition of the view."""
        prior, view, record = self.prior, self.view, self.before
        reported, share = view.word.reported, prior.confusions[view.stretch].outlier_share
        words = (*record.words, *[word for word in reported if word not in record.words])
        places, before = [words.index(word) for word in reported], _with_room(record.counts, len(words))
        base = prior.factors * prior.prior_of(view).T[reported, None]
        meant = (base + before[places]) * _weights(prior, reported, view).T[..., None] / self.totals
        return ViewShares(
            words=words,
            before=before,
            reported=places,
            likelihood=self.likelihood,
            base=base,
            added=meant * (self.anew * (1.0 - share) / self.likelihood),
            joint_inlier=self.inlier,
            joint_outlier=self.anew * (share / prior.num_words),
        )


def _first_gained(prior: LabelPrior, view: LabelView) -> Array:
    """(K,) log likelihood gain of each row from a first view's second word."""
    gains, kinds = prior.first_gains, np.full(prior.num_words, NEITHER)
    kinds[view.word.second], kinds[view.word.answer], kinds[-1] = TRUTH, RIGHT, RIGHT
    return np.asarray(gains[kinds[prior.classes_of_rows]])


def _weights(prior: LabelPrior, words: tuple[int, ...], view: LabelView) -> Array:
    """(R, N) weight of each word in a view: one-hot for the answer, or a power of its scores."""
    return view.word.meant(words, prior.powers)[prior.power_of]


def _with_room(counts: Array, num_words: int) -> Array:
    """Counts padded with zeros to (N, R, K) for new words."""
    new = num_words - len(counts)
    return counts if new == 0 else np.concatenate([counts, np.zeros((new, *counts.shape[1:]))])

"""What a detector's words tell of an object's class, with its confusions integrated out for each object.

An object of class c is called by a row of probabilities theta_c over words, which nobody knows: Dirichlet. Before
anybody has counted what the detector confuses, most of the counts are on the class's own label and the rest is spread
evenly. Fitted ones are the detector's, and may depend on the side that is seen (:class:`Confusion`), with the object's
heading one of several that are as likely. An object that none of the labels means is either called otherwise, too, or
by any label alike. Words count one after the other (Polya's urn), for each object by itself.

Views repeat themselves. From the place of an earlier view the detector repeats that answer with a probability rho,
whatever the object is, and else answers anew; rho decreases by 1 / e with every ``repeat_rad`` by which the direction
of view or the logarithm of the distance differ. Of the answers that are new a share e are outliers, any word alike:

    P(word | c, earlier) = rho [word = that of the nearest earlier view] + (1 - rho) ((1 - e) theta_c(word) + e / W).

Scores say how sure an answer is: q(w), in place of [w = word], in sum_w theta_c(w) q(w). They are densities relative to
that of scores under any class.

How large rho is from the same place, whether scores tell more than the word, and how many counts a row has (few: each
object is confused in a way of its own; many: any box may be confused) is decided by evidence, in settings that have
weights before the first view: by that of all objects, for the detector is one.

Given theta the recursion is exact, and given which answers are new and what they mean so are the counts. Together they
are not: an answer counts by the probability that it is new and means the word (assumed-density filtering).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.perception.class_names import NONE_OF_THESE as NONE_OF_THESE
from semantic_slam.viewpoint.label_confusion import DIRECTIONS, HIDDEN_NONE, Confusion
from semantic_slam.viewpoint.label_record import ANY_STRETCH, LabelRecord, LabelView, ViewShares
from semantic_slam.viewpoint.label_runner_up import EVEN_HABITS, RunnersUp
from semantic_slam.viewpoint.label_settings import LabelSettings


@dataclass(frozen=True, kw_only=True)
class LabelModel:
    """P(words of an object | class), the confusion of its class integrated out; L labels, W = L + 1 words."""

    labels: tuple[str, ...]  # L, all different
    settings: LabelSettings  # R
    confusions: tuple[Confusion, ...]  # of each stretch, fitted without it; the last of all other views
    class_shares: Array  # (C,) probability that an object that no map knows is of each class
    stretch_edges_ns: tuple[int, ...] = field(default=())  # where stretches begin, and where the last one ends
    habits: Array = field(default_factory=lambda: EVEN_HABITS)  # (H,) shares of objects by how second words come
    is_lean: bool = True  # classes that look alike from all sides have one heading

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) the labels, and none of these."""
        return (*self.labels, NONE_OF_THESE)

    @property
    def num_words(self) -> int:
        """W, with the word that stands for any other label."""
        return len(self.labels) + 1

    @property
    def num_settings(self) -> int:
        """R, of which the detector has one."""
        return len(self.settings)

    @property
    def num_headings(self) -> int:
        """Ways in which objects may be turned."""
        return self.confusions[-1].num_sectors

    @cached_property
    def headings(self) -> Index:
        """(L,) ways in which an object of a class may be turned, as far as that makes a difference."""
        is_sided = np.any([own.is_sided for own in self.confusions], axis=0)
        return np.where(is_sided | (not self.is_lean), self.num_headings, 1)

    @cached_property
    def _first_rows(self) -> Index:
        """(L,) the first row of each class."""
        return np.cumsum(self.headings) - self.headings

    @cached_property
    def priors(self) -> tuple[Array, ...]:
        """(S, K, W) Dirichlet counts of each row before any view, by sector of the map, for each of ``confusions``."""
        return tuple(confusion.rows(self.headings) for confusion in self.confusions)

    @cached_property
    def _classes_of_rows(self) -> tuple[Index, Array]:
        """(K,) the class of each row, and the log number of rows that it has."""
        numbers = np.append(self.headings, HIDDEN_NONE)
        return np.repeat(np.arange(len(numbers)), numbers), np.repeat(np.log(numbers), numbers)

    def log_rows(self, log_prior: Array) -> Array:
        """(K,) log prior of each row, from the (C,) of the classes."""
        classes, log_numbers = self._classes_of_rows
        return np.asarray(log_prior[classes] - log_numbers)

    @cached_property
    def _factors(self) -> Array:
        """(R, K) on the Dirichlet counts of each row before any view."""
        own = np.repeat(self.settings.count_factors[:, None], self.headings.sum(), axis=1)
        others = np.repeat(self.settings.other_factors[:, None], HIDDEN_NONE, axis=1)
        return np.concatenate([own, others], axis=1)

    def stretch_of(self, stamp_ns: int) -> int:
        """Stretch of the drive that a stamp lies in, where the models were fitted to this drive."""
        edges = self.stretch_edges_ns
        if not edges or not edges[0] <= stamp_ns <= edges[-1]:
            return ANY_STRETCH
        return min(int(np.searchsorted(edges, stamp_ns, side="right")) - 1, len(edges) - 2)

    def start(self) -> LabelRecord:
        """Nothing seen yet."""
        return self._nothing

    @cached_property
    def _nothing(self) -> LabelRecord:
        size = (self.num_settings, self.priors[-1].shape[1])
        return LabelRecord(
            log_likelihood=np.zeros(size),
            words=(),
            counts=np.zeros((0, *size)),
            answers=np.full(DIRECTIONS, -1),
            log_ranges=np.full(DIRECTIONS, np.inf),
            seconds=RunnersUp.start(self.num_words, self.habits),
        )

    def after(self, record: LabelRecord, view: LabelView) -> LabelRecord:
        """With one more view."""
        if view.answer < 0:
            return replace(record, log_likelihood=record.log_likelihood - np.log(self.num_words))
        return self.counted(record, view, self.shares(record, view)) if record.words else self._first(record, view)

    def _first(self, record: LabelRecord, view: LabelView) -> LabelRecord:
        """With the first view that has a word: there is none to repeat, and how many counts a row has cancels."""
        prior, words = self._prior(view), list(view.reported)
        share = self.confusions[view.stretch].outlier_share
        totals = self._totals[view.stretch][self.confusions[view.stretch].sector_of(view.direction)]
        new = np.array([prior[:, view.answer], prior @ view.shares]) / totals  # (2, K) by the word alone, and by scores
        likelihood = (1.0 - share) * new + share / self.num_words
        meant = np.array([[float(word == view.answer) for word in words], view.shares[words]])  # (2, n)
        counts = (prior.T[words, None] * meant.T[..., None]) * ((1.0 - share) / (totals * likelihood))  # (n, 2, K)
        answers, log_ranges = record.newest_with(view)
        seconds = record.seconds.after(record.runner_up(view, (view.direction, 0.0)), view.direction)
        return LabelRecord(
            log_likelihood=self._with_second(record.log_likelihood + np.log(likelihood)[self._by_score], seconds),
            words=view.reported,
            counts=counts[:, self._by_score],
            answers=answers,
            log_ranges=log_ranges,
            seconds=seconds,
        )

    def _with_second(self, log_likelihood: Array, seconds: RunnersUp) -> Array:
        """(R, K) log likelihood with the last second word, where scores do not count besides; changed in place."""
        log_likelihood[self._by_word] += seconds.gained[self._classes_of_rows[0]]
        return log_likelihood

    def counted(self, record: LabelRecord, view: LabelView, shares: ViewShares) -> LabelRecord:
        """With one more view, which has a word, by what it may be."""
        answers, log_ranges = record.newest_with(view)
        seconds = record.seconds.after(record.runner_up(view, shares.nearest), view.direction)
        return LabelRecord(
            log_likelihood=self._with_second(record.log_likelihood + np.log(shares.likelihood), seconds),
            words=shares.words,
            counts=shares.after,
            answers=answers,
            log_ranges=log_ranges,
            seconds=seconds,
        )

    def shares(self, record: LabelRecord, view: LabelView) -> ViewShares:
        """What one more view, which has a word, may be."""
        reported = view.reported
        words = (*record.words, *[word for word in reported if word not in record.words])
        places = [words.index(word) for word in reported]
        before = _with_room(record.counts, len(words))
        nearest = record.nearest(view)
        repeating, earlier = self._repeats(record, nearest)  # (R, 1), a word
        new, base, meant = self._meant(before, words, places, view)
        share = self.confusions[view.stretch].outlier_share
        anew = 1.0 - repeating
        inlier = (anew * (1.0 - share)) * new
        outlier = anew * (share / self.num_words)
        likelihood = inlier + (outlier + repeating if earlier == view.answer else outlier)
        return ViewShares(
            nearest=nearest,
            words=words,
            before=before,
            reported=places,
            likelihood=likelihood,
            base=base,
            added=meant * (anew * (1.0 - share) / likelihood),
            joint_inlier=inlier,
            joint_outlier=outlier,
        )

    def by_setting(self, record: LabelRecord) -> Array:
        """(R, C) log likelihood of all views under each setting, over headings and what none of these may be."""
        told = record.log_likelihood
        classes = np.empty((len(told), len(self.class_shares)))
        classes[:, :-1] = self._over_headings(told[:, :-HIDDEN_NONE])
        classes[:, -1] = np.logaddexp.reduce(told[:, -HIDDEN_NONE:], axis=1) - np.log(HIDDEN_NONE)
        return classes

    def _over_headings(self, told: Array) -> Array:
        """(R, L) log means over the headings of each class."""
        if told.shape[1] == len(self.labels):
            return told
        first, headings = self._first_rows, self.headings
        greatest = np.maximum.reduceat(told, first, axis=1)
        shares = np.exp(told - np.repeat(greatest, headings, axis=1))
        return np.asarray(np.log(np.add.reduceat(shares, first, axis=1) / headings) + greatest)

    def class_log_likelihood(self, record: LabelRecord) -> Array:
        """(C,) log likelihood of all views, where nothing else tells which setting is right."""
        weighted = self.by_setting(record) + self.settings.log_weights[:, None]
        return np.asarray(finite_log_sum_exp(weighted, axis=0))

    @cached_property
    def _totals(self) -> tuple[Array, ...]:
        """(S, K) sums of ``priors`` over the words."""
        return tuple(prior.sum(axis=2) for prior in self.priors)

    def _prior(self, view: LabelView) -> Array:
        """(K, W) counts before any view of the words that this one draws from."""
        return np.asarray(self.priors[view.stretch][self.confusions[view.stretch].sector_of(view.direction)])

    @cached_property
    def _by_score(self) -> Index:
        """(R,) 1 where scores count besides the word, else 0."""
        return self.settings.by_score.astype(int)

    @cached_property
    def _by_word(self) -> Index:
        """Settings by which the words alone count."""
        return np.flatnonzero(self.settings.by_score == 0)

    def word_probabilities(self, record: LabelRecord, view: LabelView) -> Array:
        """(R, K, W) of what one more view may be called; its own answer and scores do not matter."""
        repeating, earlier = self._repeats(record, record.nearest(view))
        counts = self._factors[..., None] * self._prior(view)
        counts[..., list(record.words)] += np.moveaxis(record.counts, 0, -1)
        share = self.confusions[view.stretch].outlier_share
        new = (1.0 - share) * counts / counts.sum(axis=2, keepdims=True) + share / self.num_words
        repeated = repeating[..., None] * (np.arange(self.num_words) == earlier)
        return np.asarray(repeated + (1.0 - repeating[..., None]) * new)

    def _repeats(self, record: LabelRecord, nearest: tuple[int, float]) -> tuple[Array, int]:
        """(R, 1) probabilities that the nearest earlier view is repeated, and its word."""
        place, away = nearest
        share = self.settings.repeat_shares * np.exp(-away / self.settings.repeat_rads)
        return share[:, None], int(record.answers[place])

    def _meant(
        self, before: Array, words: tuple[int, ...], places: list[int], view: LabelView
    ) -> tuple[Array, Array, Array]:
        """(R, K) sum of q(w) E[theta(w)] over all words; of those at ``places`` (n, R, K) prior counts and parts.

        ``before`` (N, R, K) counts of the ``words`` (N,), which the answer is one of.
        """
        prior, factors, by_score = self._prior(view), self._factors, self._by_score
        sector = self.confusions[view.stretch].sector_of(view.direction)
        total = factors * self._totals[view.stretch][sector] + before.sum(axis=0)
        of_class = factors * np.array([prior[:, view.answer], prior @ view.shares])[by_score]
        is_answer = [float(word == view.answer) for word in words]
        weights = np.array([is_answer, view.shares[list(words)]])[by_score]  # (R, N) how far each word is meant
        of_object = np.einsum("rn,nrk->rk", weights, before)
        base = factors * prior.T[list(view.reported), None]
        meant = (base + before[places]) * weights.T[places, :, None] / total
        return (of_class + of_object) / total, base, meant


def _with_room(counts: Array, num_words: int) -> Array:
    """(N, R, K) counts of more words, 0 of those that are new."""
    new = num_words - len(counts)
    return counts if new == 0 else np.concatenate([counts, np.zeros((new, *counts.shape[1:]))])

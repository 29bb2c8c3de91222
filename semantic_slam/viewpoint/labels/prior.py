"""Prior of the label model before an object has been seen, as tables over settings, rows and words."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.perception.class_names import NONE_OF_THESE as NONE_OF_THESE
from semantic_slam.viewpoint.labels.confusion import HIDDEN_NONE, Confusion
from semantic_slam.viewpoint.labels.record import ANY_STRETCH, LabelRecord, LabelView, NearestView, NewestViews
from semantic_slam.viewpoint.labels.runner_up import EVEN_HABITS, LEAST_WORDS, RunnersUp, first_gains
from semantic_slam.viewpoint.labels.settings import LabelSettings


@dataclass(frozen=True, kw_only=True)
class LabelPrior:
    """Settings, confusion priors and class frequencies; L labels, W = L + 1 words, R settings, K rows."""

    labels: tuple[str, ...]  # L, all different
    settings: LabelSettings  # R
    confusions: tuple[Confusion, ...]  # one per stretch, fitted without it; the last for all other views
    class_shares: Array  # (C,) class prior of an object that is in no map
    stretch_edges_ns: tuple[int, ...] = field(default=())  # starts of the stretches, and the end of the last
    habits: Array = field(default_factory=lambda: EVEN_HABITS)  # (H,) share of objects with each second-word habit
    is_lean: bool = True  # classes that do not depend on the side have a single heading

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) the labels, then the class "none of these"."""
        return (*self.labels, NONE_OF_THESE)

    @property
    def num_words(self) -> int:
        """Number of words W, including the one that stands for any other label."""
        return len(self.labels) + 1

    @property
    def num_settings(self) -> int:
        """Number of settings R, exactly one of which applies to the detector."""
        return len(self.settings)

    @property
    def num_headings(self) -> int:
        """Number of discrete headings of an object."""
        return self.confusions[-1].num_sectors

    @cached_property
    def headings(self) -> Index:
        """(L,) number of distinguishable headings of an object of each class."""
        is_sided = np.any([own.is_sided for own in self.confusions], axis=0)
        return np.where(is_sided | (not self.is_lean), self.num_headings, 1)

    @cached_property
    def priors(self) -> tuple[Array, ...]:
        """(S, K, W) Dirichlet counts of each row before any view, by sector of the map, for each of ``confusions``."""
        return tuple(confusion.rows(self.headings) for confusion in self.confusions)

    @cached_property
    def totals(self) -> tuple[Array, ...]:
        """(S, K) sums of ``priors`` over the words."""
        return tuple(prior.sum(axis=2) for prior in self.priors)

    @cached_property
    def weighted_totals(self) -> tuple[Array, ...]:
        """(S, R, K) ``totals`` multiplied by the ``factors`` of each setting."""
        return tuple(self.factors * total[:, None] for total in self.totals)

    @cached_property
    def factors(self) -> Array:
        """(R, K) multipliers of each row's prior Dirichlet counts, per setting."""
        own = np.repeat(self.settings.count_factors[:, None], self.headings.sum(), axis=1)
        others = np.repeat(self.settings.other_factors[:, None], HIDDEN_NONE, axis=1)
        return np.concatenate([own, others], axis=1)

    @cached_property
    def powers(self) -> tuple[float, ...]:
        """Q different powers of scores among the settings, ascending; 0: the word alone counts."""
        return tuple(np.unique(self.settings.score_powers).tolist())

    @cached_property
    def power_of(self) -> Index:
        """(R,) place of each setting's power among :attr:`powers`."""
        return np.searchsorted(self.powers, self.settings.score_powers)

    @cached_property
    def is_by_word(self) -> Flags:
        """(Q,) whether a power of scores lets the words alone count."""
        return np.asarray(np.array(self.powers) == 0.0)

    @cached_property
    def by_word(self) -> Array:
        """(R, 1) 1 where the setting uses the words alone, else 0."""
        return np.asarray((self.settings.score_powers == 0.0).astype(np.float64)[:, None])

    @cached_property
    def classes_of_rows(self) -> Index:
        """(K,) class index of each row."""
        numbers = np.append(self.headings, HIDDEN_NONE)
        return np.repeat(np.arange(len(numbers)), numbers)

    @cached_property
    def _log_rows_of_class(self) -> Array:
        """(K,) log of the number of rows of each row's class."""
        numbers = np.append(self.headings, HIDDEN_NONE)
        return np.repeat(np.log(numbers), numbers)

    def log_rows(self, log_prior: Array) -> Array:
        """(..., K) log prior of the rows, from the (..., C) log prior of the classes."""
        return np.asarray(log_prior[..., self.classes_of_rows] - self._log_rows_of_class)

    def stretch_of(self, stamp_ns: int) -> int:
        """Index of the stretch that contains a stamp; ``ANY_STRETCH`` where the models were not fitted to the drive."""
        edges = self.stretch_edges_ns
        if not edges or not edges[0] <= stamp_ns <= edges[-1]:
            return ANY_STRETCH
        return min(int(np.searchsorted(edges, stamp_ns, side="right")) - 1, len(edges) - 2)

    def sector_of(self, view: LabelView) -> int:
        """Map sector from which a view is taken."""
        return self.confusions[view.stretch].sector_of(view.direction)

    def prior_of(self, view: LabelView) -> Array:
        """(K, W) prior counts that apply to a view, by its stretch and sector."""
        return np.asarray(self.priors[view.stretch][self.sector_of(view)])

    def drawn(self, view: LabelView) -> Array:
        """(Q, K) prior counts of what a view shows, by each of :attr:`powers` of its scores."""
        prior, word = self.prior_of(view), view.word
        return np.array([prior @ word.calibrated(power) if power else prior[:, word.answer] for power in self.powers])

    @cached_property
    def first_gains(self) -> Array:
        """(3,) log likelihood gain of a first view's second word, for the relations RIGHT, TRUTH and NEITHER."""
        return first_gains(self.num_words, self.habits) if self.num_words >= LEAST_WORDS else np.zeros(3)

    def repeats(self, nearest: NearestView) -> Array:
        """(R, 1) probabilities that the nearest earlier view is repeated."""
        share = self.settings.repeat_shares * np.exp(-nearest.away / self.settings.repeat_rads)
        return np.asarray(share[:, None])

    def start(self) -> LabelRecord:
        """Empty record of an object not yet seen."""
        return self._nothing

    @cached_property
    def _nothing(self) -> LabelRecord:
        size = (self.num_settings, self.priors[-1].shape[1])
        return LabelRecord(
            log_likelihood=np.zeros(size),
            words=(),
            counts=np.zeros((0, *size)),
            newest=NewestViews.none(),
            seconds=RunnersUp.start(self.num_words, self.habits),
        )

    def by_class(self, told: Array) -> Array:
        """(..., C) class log likelihood from (..., K) rows, marginalised over headings and "none" hypotheses."""
        classes = np.empty((*told.shape[:-1], len(self.class_shares)))
        classes[..., :-1] = self._over_headings(told[..., :-HIDDEN_NONE])
        classes[..., -1] = np.logaddexp.reduce(told[..., -HIDDEN_NONE:], axis=-1) - np.log(HIDDEN_NONE)
        return classes

    @cached_property
    def _first_rows(self) -> Index:
        """(L,) the first row of each class."""
        return np.cumsum(self.headings) - self.headings

    def _over_headings(self, told: Array) -> Array:
        """(..., L) log of the mean over the headings of each class."""
        if told.shape[-1] == len(self.labels):
            return told
        first, headings = self._first_rows, self.headings
        greatest = np.maximum.reduceat(told, first, axis=-1)
        shares = np.exp(told - np.repeat(greatest, headings, axis=-1))
        return np.asarray(np.log(np.add.reduceat(shares, first, axis=-1) / headings) + greatest)

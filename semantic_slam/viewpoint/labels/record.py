"""Label observations of one object: a view, the record of all views, and the analysis of one more view."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.viewpoint.labels.confusion import TURNS, turns_in_space
from semantic_slam.viewpoint.labels.runner_up import NONE, RunnersUp, RunnerUp

LEAST_REPORTED = 1.0 + 1e-9
"""Scores above the minimum by this factor were reported; the remaining words share the rest evenly."""
ANY_STRETCH = -1
"""Stretch index of a view outside the fitted stretches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelWord:
    """Label and scores that a detector gives one box, independent of the object."""

    answer: int  # the word, -1: none
    shares: Array  # (W,) scores of all words

    def calibrated(self, power: float) -> Array:
        """(W,) probabilities of what the box shows, by a power of the scores, which is normalised.

        A power below 1 is that of a detector that is surer than right, one above 1 of one that is less sure than it
        might be (temperature scaling, Guo et al. 2017, with the inverse temperature).
        """
        if power == 1.0:
            return self.shares
        raised = (self.shares / self.shares.max()) ** power
        return np.asarray(raised / raised.sum())

    def meant(self, words: Sequence[int], powers: Sequence[float]) -> Array:
        """(Q, N) probabilities that the box shows some words, by powers of the scores; 0: the answer alone counts."""
        places, by_answer = list(words), [float(word == self.answer) for word in words]
        return np.array([self.calibrated(power)[places] if power else by_answer for power in powers])

    @cached_property
    def reported(self) -> tuple[int, ...]:
        """Indices of the words that were reported."""
        scored = np.flatnonzero(self.shares > self.shares.min() * LEAST_REPORTED).tolist()
        return tuple(scored) if self.answer in scored else (*scored, self.answer)

    @cached_property
    def second(self) -> int:
        """Best-scored word besides the answer, -1 where none was reported."""
        others = [word for word in self.reported if word != self.answer]
        return max(others, key=self.shares.__getitem__) if others else NONE


@dataclass(frozen=True, kw_only=True)
class LabelView:
    """One labelled view of an object and its viewpoint."""

    word: LabelWord
    direction: int  # azimuth cell of the direction from object to camera, in the map frame
    log_range: float  # of the distance in metres, in steps of ``STEP_RAD``
    elevation: int = 0  # elevation cell of that direction, 0 in the plane
    stretch: int = ANY_STRETCH  # stretch index of the drive


class NearestView(NamedTuple):
    """Words of the nearest earlier view, -1 where there is none, and its distance in angle and log range."""

    answer: int
    second: int
    away: float

    def repeated_by(self, view: LabelView) -> RunnerUp:
        """Second word of a view, with the earlier second word that it may repeat."""
        earlier = self.second if self.answer == view.word.answer else NONE
        return RunnerUp(first=view.word.answer, second=view.word.second, earlier=earlier, away=self.away)


NO_VIEW = NearestView(answer=-1, second=NONE, away=np.inf)
"""Stands for the nearest earlier view of an object not yet seen."""


@dataclass(frozen=True, kw_only=True)
class NewestViews:
    """Newest view of an object from each of P places: cells of azimuth and elevation, and a step of the log range.

    The number of places is bounded by the numbers of cells and of steps between the nearest and the farthest view.
    """

    directions: Index  # (P,) azimuth cells, ascending
    elevations: Index  # (P,) elevation cells
    log_ranges: Array  # (P,)
    words: Index  # (2, P) first and second word, -1 where there is none

    @classmethod
    def none(cls) -> Self:
        """No view yet."""
        cells = np.zeros(0, dtype=int)
        return cls(directions=cells, elevations=cells, log_ranges=np.zeros(0), words=np.zeros((2, 0), dtype=int))

    def nearest(self, view: LabelView) -> NearestView:
        """Nearest earlier view; among equally near ones that of the lowest azimuth cell."""
        if not len(self.directions):
            return NO_VIEW
        away = np.hypot(self._turns(view), self.log_ranges - view.log_range)
        place = int(away.argmin())
        answer, second = self.words[:, place].tolist()
        return NearestView(answer=answer, second=second, away=float(away[place]))

    def following(self, view: LabelView) -> Self:
        """With one more view, in place of an earlier one from its place."""
        first, end = np.searchsorted(self.directions, [view.direction, view.direction + 1]).tolist()
        from_there = self.elevations[first:end] == view.elevation
        same = np.flatnonzero(from_there & (self.log_ranges[first:end] == view.log_range))
        start = first + int(same[0]) if len(same) else end
        rest = start + len(same)
        words = np.array([[view.word.answer], [view.word.second]])
        return type(self)(
            directions=np.concatenate([self.directions[:start], [view.direction], self.directions[rest:]]),
            elevations=np.concatenate([self.elevations[:start], [view.elevation], self.elevations[rest:]]),
            log_ranges=np.concatenate([self.log_ranges[:start], [view.log_range], self.log_ranges[rest:]]),
            words=np.concatenate([self.words[:, :start], words, self.words[:, rest:]], axis=1),
        )

    def _turns(self, view: LabelView) -> Array:
        """(P,) angles [rad] between the directions of all places and that of a view."""
        if view.elevation == 0 and not self.elevations.any():
            return np.asarray(TURNS[view.direction, self.directions])
        return turns_in_space(self.directions - view.direction, self.elevations, view.elevation)


@dataclass(frozen=True, kw_only=True)
class LabelRecord:
    """Label statistics of one object so far; R settings, K rows (``Confusion.rows``), N words."""

    log_likelihood: Array  # (R, K) of all views
    words: tuple[int, ...]  # (N) words reported so far
    counts: Array  # (N, R, K) of new answers
    newest: NewestViews  # one from each place
    seconds: RunnersUp  # evidence of the second-best words


@dataclass(frozen=True, kw_only=True)
class ViewShares:
    """Posterior decomposition of a view (repeat, new, outlier) per setting and row, given the earlier views."""

    words: tuple[int, ...]  # N words, including those of this view
    before: Array  # (N, R, K) counts of new answers
    reported: Sequence[int]  # (n,) indices of this view's words in ``words``
    likelihood: Array  # (R, K)
    base: Array  # (n, R, K) prior counts of the reported words
    added: Array  # (n, R, K) probability that the answer is new and means a reported word
    joint_inlier: Array  # (R, K) joint likelihood with the answer new and an inlier
    joint_outlier: Array  # (R, 1) joint likelihood with the answer an outlier

    @property
    def inlier(self) -> Array:
        """(R, K) posterior probability that the answer is new and an inlier."""
        return np.asarray(self.joint_inlier / self.likelihood)

    @property
    def outlier(self) -> Array:
        """(R, K) posterior probability that the answer is an outlier."""
        return np.asarray(self.joint_outlier / self.likelihood)

    @property
    def after(self) -> Array:
        """(N, R, K) counts of new answers, including this one."""
        counts = self.before.copy()
        for place, added in zip(self.reported, self.added, strict=True):
            counts[place] += added
        return counts

    @property
    def drawn(self) -> Array:
        """(n, R, K) part of ``added`` drawn from the class prior rather than from the object's own earlier words."""
        return np.asarray(self.added * self.base / (self.base + self.before[self.reported]))

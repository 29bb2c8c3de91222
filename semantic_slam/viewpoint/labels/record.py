"""Label observations of one object: a view, the record of all views, and the analysis of one more view."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, TURNS
from semantic_slam.viewpoint.labels.runner_up import NONE, RunnersUp, RunnerUp

LEAST_REPORTED = 1.0 + 1e-9
"""Scores above the minimum by this factor were reported; the remaining words share the rest evenly."""
LOG_RANGE, ANSWER, SECOND = 0, 1, 2
"""Rows of ``LabelRecord.newest``: log distance in metres (inf where unseen), and first and second word (-1: none)."""
UNSEEN = np.repeat([[np.inf], [-1.0], [float(NONE)]], DIRECTIONS, axis=1)
"""(3, DIRECTIONS) initial ``newest`` of an object not yet seen."""
ANY_STRETCH = -1
"""Stretch index of a view outside the fitted stretches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelWord:
    """Label and scores that a detector gives one box, independent of the object."""

    answer: int  # the word, -1: none
    shares: Array  # (W,) scores of all words

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
    log_range: float  # of the distance in metres
    stretch: int = ANY_STRETCH  # stretch index of the drive


@dataclass(frozen=True, kw_only=True)
class LabelRecord:
    """Label statistics of one object so far; R settings, K rows (``Confusion.rows``), N words."""

    log_likelihood: Array  # (R, K) of all views
    words: tuple[int, ...]  # (N) words reported so far
    counts: Array  # (N, R, K) of new answers
    newest: Array  # (3, DIRECTIONS) of the newest view from each direction: LOG_RANGE, ANSWER, SECOND
    seconds: RunnersUp  # evidence of the second-best words

    def nearest(self, view: LabelView) -> tuple[int, float]:
        """Azimuth cell of the nearest earlier view, and its distance in angle and log range."""
        away = np.hypot(TURNS[view.direction], self.newest[LOG_RANGE] - view.log_range)
        place = int(away.argmin())
        return place, float(away[place])

    def runner_up(self, view: LabelView, nearest: tuple[int, float]) -> RunnerUp:
        """Second word of a view, with the earlier second word that it may repeat."""
        place, away = nearest
        same = self.newest[ANSWER, place] == view.word.answer
        earlier = int(self.newest[SECOND, place]) if same else NONE
        return RunnerUp(first=view.word.answer, second=view.word.second, earlier=earlier, away=away)

    def newest_with(self, view: LabelView) -> Array:
        """(3, DIRECTIONS) ``newest`` updated with one more view."""
        newest = self.newest.copy()
        newest[:, view.direction] = view.log_range, view.word.answer, view.word.second
        return newest


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

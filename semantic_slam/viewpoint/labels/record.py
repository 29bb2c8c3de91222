"""What a detector has said of one object: a view, the record of all views, and what one more may be."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, TURNS
from semantic_slam.viewpoint.labels.runner_up import NONE, RunnersUp, RunnerUp

LEAST_REPORTED = 1.0 + 1e-9
"""Scores above the least by this factor were reported; the others share evenly what these leave."""
LOG_RANGE, ANSWER, SECOND = 0, 1, 2
"""Rows of ``LabelRecord.newest``: logarithm of the distance in metres, inf where nothing was seen; words, -1: none."""
UNSEEN = np.repeat([[np.inf], [-1.0], [float(NONE)]], DIRECTIONS, axis=1)
"""(3, DIRECTIONS) of an object that nobody has seen."""
ANY_STRETCH = -1
"""Stretch of a view of which no model was fitted without it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelWord:
    """What a detector calls one of its boxes, whichever object it is of."""

    answer: int  # the word, -1: none
    shares: Array  # (W,) scores of all words

    @cached_property
    def reported(self) -> tuple[int, ...]:
        """The words that were reported."""
        scored = np.flatnonzero(self.shares > self.shares.min() * LEAST_REPORTED).tolist()
        return tuple(scored) if self.answer in scored else (*scored, self.answer)

    @cached_property
    def second(self) -> int:
        """The word with the best score besides the answer, -1 where none was reported."""
        others = [word for word in self.reported if word != self.answer]
        return max(others, key=self.shares.__getitem__) if others else NONE


@dataclass(frozen=True, kw_only=True)
class LabelView:
    """What a detector says of one object at a time, and from where it is seen."""

    word: LabelWord
    direction: int  # cell of the direction from object to camera, in map
    log_range: float  # of the distance in metres
    stretch: int = ANY_STRETCH  # of the drive


@dataclass(frozen=True, kw_only=True)
class LabelRecord:
    """The words of one object so far; R settings, K rows (``Confusion.rows``), N words."""

    log_likelihood: Array  # (R, K) of all views
    words: tuple[int, ...]  # N that were reported
    counts: Array  # (N, R, K) of new answers
    newest: Array  # (3, DIRECTIONS) of the newest view from each direction: LOG_RANGE, ANSWER, SECOND
    seconds: RunnersUp  # what the best words besides the answers tell

    def nearest(self, view: LabelView) -> tuple[int, float]:
        """Direction of the nearest earlier view, and how far it is: by turn and by the logarithm of the distance."""
        away = np.hypot(TURNS[view.direction], self.newest[LOG_RANGE] - view.log_range)
        place = int(away.argmin())
        return place, float(away[place])

    def runner_up(self, view: LabelView, nearest: tuple[int, float]) -> RunnerUp:
        """The second word of a view, and what it may repeat."""
        place, away = nearest
        same = self.newest[ANSWER, place] == view.word.answer
        earlier = int(self.newest[SECOND, place]) if same else NONE
        return RunnerUp(first=view.word.answer, second=view.word.second, earlier=earlier, away=away)

    def newest_with(self, view: LabelView) -> Array:
        """(3, DIRECTIONS) ``newest`` with one more view."""
        newest = self.newest.copy()
        newest[:, view.direction] = view.log_range, view.word.answer, view.word.second
        return newest


@dataclass(frozen=True, kw_only=True)
class ViewShares:
    """What a view may be under each setting and row, given the views before."""

    words: tuple[int, ...]  # N with those of this view
    before: Array  # (N, R, K) counts of new answers
    reported: Sequence[int]  # (n,) places of this view's words among them
    likelihood: Array  # (R, K)
    base: Array  # (n, R, K) counts of the reported words before any view
    added: Array  # (n, R, K) probability that it is new and means a reported word
    joint_inlier: Array  # (R, K) likelihood with it new and no outlier
    joint_outlier: Array  # (R, 1) with it an outlier

    @property
    def inlier(self) -> Array:
        """(R, K) probability that it is new and no outlier."""
        return np.asarray(self.joint_inlier / self.likelihood)

    @property
    def outlier(self) -> Array:
        """(R, K) probability that it is an outlier."""
        return np.asarray(self.joint_outlier / self.likelihood)

    @property
    def after(self) -> Array:
        """(N, R, K) counts of new answers with this one."""
        counts = self.before.copy()
        for place, added in zip(self.reported, self.added, strict=True):
            counts[place] += added
        return counts

    @property
    def drawn(self) -> Array:
        """(n, R, K) share of ``added`` that is drawn from what the class is called, not from the object's own words."""
        return np.asarray(self.added * self.base / (self.base + self.before[self.reported]))

"""What scores tell of whether objects exist: of false alarms, and of what is mistaken again and again at one place.

The scores of an object's detections tell, see ``alarm_scores`` and ``detector_scores``. They repeat from one keyframe
to the next as places do. Scores weigh no association here, which leaves some of what they tell unused.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration, OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.alarm_scores import AlarmScores
from semantic_slam.inference.semantics.detector_scores import ScoreKinds, log_odds, moments_of

MORE = 1.05
"""Factor on the number of scores from which on their kinds are found anew."""


class GenuineObjects:
    """Follows the scores of each live hypothesis's objects, keyframe by keyframe."""

    def __init__(
        self, settings: OpenWorldConfiguration, errors: DetectionErrorsConfiguration, *, counts_misses: bool = True
    ) -> None:
        """Without ``counts_misses`` nothing shows what a false alarm is."""
        self._learns_kinds, self._learns_alarms = settings.learn_scores, settings.learn_alarm_scores and counts_misses
        self._errors = errors
        self._news: list[float] = []  # of each keyframe, the share of a score that the keyframe before has not told
        self._moments: list[Array] = []  # of each keyframe (D, 3)
        self._odds: list[Array] = []  # of each keyframe (d,), those that are told
        self._kinds: ScoreKinds | None = None
        self._num_fitted = 0  # scores in them
        self._of: dict[int, Array] = {}  # hypothesis -> (N, 3) sums of moments by object id, each as far as it is news

    @property
    def is_on(self) -> bool:
        """Whether scores tell anything."""
        return self._learns_kinds or self._learns_alarms

    def note(self, step: Step) -> None:
        """Take in the scores of one more keyframe."""
        if not self.is_on:
            return
        odds = log_odds(np.asarray(step.scores, dtype=np.float64))
        self._news.append(self._share_of_news(step))
        self._moments.append(moments_of(odds))
        self._odds.append(odds[np.isfinite(odds)])

    def shares(self, live: Mapping[int, Hypothesis], object_ids: Sequence[int], things: Array) -> Array | None:
        """(H, O) of what places tell of each live hypothesis's objects, heaviest first, that scores leave; None: all.

        ``things`` (H, O) is how likely each is a thing by its places, there yet or gone.
        """
        if not self.is_on or not live:
            return None
        self._of = {number: self._sums(own) for number, own in live.items()}
        ids = np.asarray(object_ids, dtype=int)
        moments = np.array([_of_ids(own, ids) for own in self._of.values()])
        if self._learns_alarms:
            return self._without_alarms(ids, things, moments)
        kinds = self._kinds_so_far()
        return None if kinds is None else kinds.genuine(moments)

    def _without_alarms(self, ids: Index, things: Array, moments: Array) -> Array | None:
        """(H, O) shares by what the scores of the heaviest hypothesis's objects, those given up too, tell."""
        heaviest = next(iter(self._of.values()))
        known = np.zeros(max(len(heaviest), 1 + max(ids, default=-1)))
        known[ids] = np.clip(np.nan_to_num(things[0]), 0.0, 1.0)
        alarms = AlarmScores.of(heaviest, known[: len(heaviest)])
        if alarms is None:
            return None
        return np.asarray(alarms.weighed(things, moments) / np.maximum(things, np.finfo(float).tiny))

    def _kinds_so_far(self) -> ScoreKinds | None:
        """The kinds of all scores so far, found anew as there are more scores."""
        counts = [len(own) for own in self._odds]
        if sum(counts) > MORE * self._num_fitted:
            self._kinds = ScoreKinds.of(np.concatenate(self._odds), np.repeat(self._news, counts))
            self._num_fitted = sum(counts)
        return self._kinds

    def _share_of_news(self, step: Step) -> float:
        """Share of a score that the keyframe before has not told."""
        if not self._news:
            return 1.0
        control, errors = step.motion.control, self._errors
        motion = np.hypot(*control[:2]) / errors.motion_m + abs(control[-1]) / errors.motion_rad
        return float(1.0 - errors.correlated_share * np.exp(-motion))

    def _sums(self, own: Hypothesis) -> Array:
        """(N, 3) of all ids so far, from the parent's where that was live; what repeats counts less."""
        before = None if own.lineage[-1].changes else self._of.get(own.parent_id)
        earlier = np.zeros((0, 3)) if before is None else before
        since = 0 if before is None else len(own.lineage) - 1
        size = max(
            len(earlier), 1 + max((max(step.association, default=-1) for step in own.lineage[since:]), default=-1)
        )
        sums = np.zeros((max(size, 1), 3))
        sums[: len(earlier)] = earlier
        rows = zip(own.lineage[since:], self._moments[since:], self._news[since:], strict=True)
        for taken, moments, news in rows:
            associated = np.array(taken.association, dtype=int)
            ids, told = associated[associated >= 0], moments[associated >= 0]
            counts = np.where(sums[ids, :1] > 0.0, news, 1.0)  # the first score of an object repeats nothing
            np.add.at(sums, ids, counts * told)
        return sums


def _of_ids(sums: Array, ids: Index) -> Array:
    """(O, 3) rows of ``sums`` (N, 3) of some ids, 0 of those beyond."""
    return np.where((ids < len(sums))[:, None], sums[np.minimum(ids, len(sums) - 1)], 0.0)

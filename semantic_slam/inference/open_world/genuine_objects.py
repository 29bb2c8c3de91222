"""Evidence of detector scores on whether objects are genuine, or false alarms repeated at one place.

The scores of an object's detections are the evidence, see ``alarm_scores`` and ``detector_scores``. They are correlated
from one keyframe to the next, as positions are. Scores do not weigh associations here, so some of their evidence is
unused.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration, OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.detector.alarm_scores import AlarmScores
from semantic_slam.inference.semantics.detector.detector_scores import ScoreKinds, log_odds, moments_of

MORE = 1.05
"""Growth factor of the number of scores at which the clusters of scores are fitted again."""


class GenuineObjects:
    """Accumulates the scores of each live hypothesis's objects, keyframe by keyframe."""

    STATE: ClassVar[tuple[str, ...]] = ("_news", "_moments", "_odds", "_kinds", "_num_fitted", "_of")

    def __init__(
        self, settings: OpenWorldConfiguration, errors: DetectionErrorsConfiguration, *, counts_misses: bool = True
    ) -> None:
        """Without ``counts_misses`` there is no evidence of what a false alarm is, so those scores are not learned."""
        self._learns_kinds, self._learns_alarms = settings.learn_scores, settings.learn_alarm_scores and counts_misses
        self._errors = errors
        self._news: list[float] = []  # per keyframe: uncorrelated share of a score
        self._moments: list[Array] = []  # per keyframe: (D, 3)
        self._odds: list[Array] = []  # per keyframe: (d,) those given
        self._kinds: ScoreKinds | None = None
        self._num_fitted = 0  # number of scores that the kinds were fitted to
        self._of: dict[int, Array] = {}  # hypothesis -> (N, 3) sums of moments by object id

    @property
    def is_on(self) -> bool:
        """Whether scores are used as evidence."""
        return self._learns_kinds or self._learns_alarms

    def note(self, step: Step) -> None:
        """Record the scores of a new keyframe."""
        if not self.is_on:
            return
        odds = log_odds(np.asarray(step.scores, dtype=np.float64))
        self._news.append(self._share_of_news(step))
        self._moments.append(moments_of(odds))
        self._odds.append(odds[np.isfinite(odds)])

    def shares(self, live: Mapping[int, Hypothesis], object_ids: Sequence[int], things: Array) -> Array | None:
        """(H, O) factors on the existence of each live hypothesis's objects, heaviest first; None: all are 1.

        ``things`` (H, O) is the probability, by positions alone, that each is an object, present or departed.
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
        """(H, O) factors learned from the scores of the heaviest hypothesis's objects, including dropped ones."""
        heaviest = next(iter(self._of.values()))
        known = np.zeros(max(len(heaviest), 1 + max(ids, default=-1)))
        known[ids] = np.clip(np.nan_to_num(things[0]), 0.0, 1.0)
        alarms = AlarmScores.of(heaviest, known[: len(heaviest)])
        if alarms is None:
            return None
        return np.asarray(alarms.weighed(things, moments) / np.maximum(things, np.finfo(float).tiny))

    def _kinds_so_far(self) -> ScoreKinds | None:
        """The clusters of all scores so far, fitted again as scores grow in number."""
        counts = [len(own) for own in self._odds]
        if sum(counts) > MORE * self._num_fitted:
            self._kinds = ScoreKinds.of(np.concatenate(self._odds), np.repeat(self._news, counts))
            self._num_fitted = sum(counts)
        return self._kinds

    def _share_of_news(self, step: Step) -> float:
        """Share of a score that is uncorrelated with the keyframe before, on average over the shares that may be."""
        if not self._news:
            return 1.0
        control, errors = step.motion.control, self._errors
        correlated = float(np.mean(errors.correlated_shares or (errors.correlated_share,)))
        motion = np.hypot(*control[:2]) / errors.motion_m + abs(control[-1]) / errors.motion_rad
        return float(1.0 - correlated * np.exp(-motion))

    def _sums(self, own: Hypothesis) -> Array:
        """(N, 3) sums for all ids so far, continued from the parent's if it was live; correlated scores count less."""
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
            counts = np.where(sums[ids, :1] > 0.0, news, 1.0)  # an object's first score counts fully
            np.add.at(sums, ids, counts * told)
        return sums


def _of_ids(sums: Array, ids: Index) -> Array:
    """(O, 3) rows of ``sums`` (N, 3) for some ids; 0 for ids beyond."""
    return np.where((ids < len(sums))[:, None], sums[np.minimum(ids, len(sums) - 1)], 0.0)

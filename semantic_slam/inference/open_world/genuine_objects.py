"""Which objects are what the detector looks for, and not what it takes for that again and again at one place.

The scores of an object's detections tell, see ``detector_scores``. Where kinds are looked for, scores repeat from one
keyframe to the next as places do. Scores weigh no association here, which leaves some of what they tell unused.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration, OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.detector_scores import ScoreKinds, log_odds, moments_of

MORE = 1.05
"""Factor on the number of scores from which on their kinds are found anew."""


class GenuineObjects:
    """Follows the scores of each live hypothesis's objects, keyframe by keyframe."""

    def __init__(self, settings: OpenWorldConfiguration, errors: DetectionErrorsConfiguration) -> None:
        self._is_on, self._errors = settings.learn_scores, errors
        self._news: list[float] = []  # of each keyframe, the share of a score that the keyframe before has not told
        self._moments: list[Array] = []  # of each keyframe (D, 3)
        self._odds: list[Array] = []  # of each keyframe (d,), those that are told
        self._kinds: ScoreKinds | None = None
        self._num_fitted = 0  # scores in them
        self._of: dict[int, Array] = {}  # hypothesis -> (N, 3) sums of moments by object id, each as far as it is news

    def note(self, step: Step) -> None:
        """Take in the scores of one more keyframe."""
        if not self._is_on:
            return
        odds = log_odds(np.asarray(step.scores, dtype=np.float64))
        self._news.append(self._share_of_news(step))
        self._moments.append(moments_of(odds))
        self._odds.append(odds[np.isfinite(odds)])

    def probabilities(self, live: Mapping[int, Hypothesis], object_ids: Sequence[int]) -> Array | None:
        """(H, O) that the objects of each live hypothesis are genuine; None where scores tell nothing."""
        if not self._is_on:
            return None
        self._of = {number: self._sums(own) for number, own in live.items()}
        kinds = self._kinds_so_far()
        if kinds is None:
            return None
        ids = np.asarray(object_ids, dtype=int)
        rows = [
            np.where((ids < len(own))[:, None], own[np.minimum(ids, len(own) - 1)], 0.0) for own in self._of.values()
        ]
        return np.array([kinds.genuine(row) for row in rows]).reshape(len(live), len(ids))

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

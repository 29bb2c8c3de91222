"""True identities of the detections that a label file keeps."""

from collections import Counter
from collections.abc import Sequence

from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations

TOPIC = topics.GROUND_TRUTH_ASSOCIATIONS


class TrueIdentities:
    """Takes the rows of dropped detections out of the associations of their stamp, whichever message comes first."""

    def __init__(self) -> None:
        self._rows: dict[int, tuple[int, tuple[int, ...]]] = {}  # by stamp: number of detections, rows that were kept
        self._waiting: dict[int, GroundTruthAssociations] = {}  # by stamp: their detections did not come yet
        self.num_contradicting = 0

    def frame(self, stamp_ns: int, count: int, kept: Sequence[int]) -> GroundTruthAssociations | None:
        """Take a frame of ``count`` detections of which the rows ``kept`` remain; returns associations now complete."""
        self._rows[stamp_ns] = count, tuple(kept)
        waiting = self._waiting.pop(stamp_ns, None)
        return None if waiting is None else self.associations(waiting)

    def associations(self, told: GroundTruthAssociations) -> GroundTruthAssociations | None:
        """The associations of what remains; None while its frame is to come, and of another number of detections."""
        if told.stamp_ns not in self._rows:
            self._waiting[told.stamp_ns] = told
            return None
        count, kept = self._rows[told.stamp_ns]
        if count != len(told.object_ids):
            self.num_contradicting += 1
            return None
        return GroundTruthAssociations(told.stamp_ns, tuple(told.object_ids[row] for row in kept))

    @property
    def dropped(self) -> Counter[str]:
        """Numbers of messages that were not passed on, by reason; only those above 0."""
        return +Counter(
            {
                f"{TOPIC}: no detections of their stamp": len(self._waiting),
                f"{TOPIC}: not as many as the detections of their stamp": self.num_contradicting,
            }
        )

"""Order in which histories take the placeholders of unmapped objects.

Placeholders are alike: histories that differ only in which of them is which object are one history. It is enumerated
once, with the placeholders taken in the order of their ids, and weighs as much as all its relabelled copies together.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from semantic_slam.geometry.arrays import Flags, Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.tracked_objects import HypothesisObjects


@dataclass(frozen=True)
class Placeholders:
    """Which of O objects are placeholders, and how many of them each of P parents has taken already."""

    ranks: Index  # (O,) place in the order of the placeholders, from 0; -1: it is none
    num_taken: Index  # (P,)

    @classmethod
    def of(
        cls, unmapped_ids: Collection[int], object_ids: Index, components: Sequence[Component]
    ) -> "Placeholders | None":
        """The placeholders among (O,) objects; None where there is at most one, which has no order."""
        if len(unmapped_ids) < 2:
            return None
        ordered = np.array(sorted(unmapped_ids), dtype=int)
        ranks = np.where(np.isin(object_ids, ordered), np.searchsorted(ordered, object_ids), -1)
        return cls(ranks, len(ordered) - num_free_placeholders(components, unmapped_ids))

    def of_parents(self, parents: slice) -> "Placeholders":
        """The placeholders of a few of the parents."""
        return replace(self, num_taken=self.num_taken[parents])

    def admitted(self, rows: Assignments) -> Flags:
        """(B, O) objects that a further detection of each row may be of: no placeholder after the first free one."""
        taken = self.num_taken[rows.parents]
        if rows.objects.shape[1]:
            taken = np.maximum(taken, 1 + np.append(self.ranks, -1)[rows.objects].max(axis=1))
        return np.asarray(self.ranks <= taken[:, None])


def free_placeholders(objects: HypothesisObjects, unmapped_ids: Collection[int]) -> Flags:
    """(O,) placeholders that a hypothesis has not detected yet, among all of its objects."""
    return np.isin(objects.ids, list(unmapped_ids)) & (objects.existence < 1.0)


def num_free_placeholders(components: Sequence[Component], unmapped_ids: Collection[int]) -> Index:
    """(P,) how many placeholders each of P hypotheses has not detected yet."""
    return np.array([free_placeholders(own.objects, unmapped_ids).sum() for own in components], dtype=int)


def log_num_labellings(num_free: int, num_new: int) -> float:
    """Log of the number of ways in which ``num_new`` objects take one each of ``num_free`` placeholders."""
    return float(gammaln(num_free + 1.0) - gammaln(num_free - num_new + 1.0))

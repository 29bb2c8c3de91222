"""Data association as a clustering of detections, scored by pairs."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

CLUTTER = -1
"""Cluster id of a detection that belongs to no object; such detections are never a pair."""


@dataclass(frozen=True)
class PairScore:
    """Pairwise co-clustering of detections; NaN where it is undefined for want of pairs."""

    precision: float
    recall: float
    f1: float


def pair_score(estimate: Sequence[int], reference: Sequence[int]) -> PairScore:
    """Score of ``estimate`` against ``reference``: one cluster id per detection of a run, clutter negative.

    A pair is two detections of one object. Precision is the share of the estimate's pairs that the reference
    has too, recall the share of the reference's pairs that the estimate found. Identities of clusters do not matter.
    """
    both = Counter((e, r) for e, r in zip(estimate, reference, strict=True) if e > CLUTTER and r > CLUTTER)
    common = _pairs(both)
    claimed = _pairs(Counter(e for e in estimate if e > CLUTTER))
    true = _pairs(Counter(r for r in reference if r > CLUTTER))
    return PairScore(_ratio(common, claimed), _ratio(common, true), _ratio(2 * common, claimed + true))


def annotated_pair_score(estimate: Sequence[int], reference: Sequence[int]) -> PairScore:
    """Score among the detections that the reference gives an object; the others may show what nobody annotated."""
    known = [(e, r) for e, r in zip(estimate, reference, strict=True) if r > CLUTTER]
    return pair_score([e for e, _ in known], [r for _, r in known])


def objects_without_reference(estimate: Sequence[int], reference: Sequence[int]) -> set[int]:
    """Objects of the ``estimate`` to most of whose detections the reference gives none."""
    told: Counter[int] = Counter()
    for own, true in zip(estimate, reference, strict=True):
        told[own] += 1 if true > CLUTTER else -1
    return {own for own, balance in told.items() if own > CLUTTER and balance < 0}


def _pairs(sizes: Counter[int] | Counter[tuple[int, int]]) -> int:
    return sum(size * (size - 1) // 2 for size in sizes.values())


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")

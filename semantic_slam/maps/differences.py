"""Changes between two maps: each object unchanged, displaced, gone or new, with probabilities."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.likelihood import GONE_SHARE
from semantic_slam.maps.saved_map import share_evidence

KINDS = ("same", "displaced", "gone", "unseen", "none")
"""Possible fates of an object of the old map; none: it never existed."""


@dataclass(frozen=True, kw_only=True)
class OldObject:
    """Fate of an object of the old map."""

    object_id: int
    name: str
    probabilities: dict[str, float]  # of KINDS
    new_id: int | None  # its id in the new map, if any
    distance_m: float  # from where it was; NaN without a counterpart
    sigma_m: float  # standard deviation of distance_m

    @property
    def kind(self) -> str:
        """Most likely of KINDS."""
        return max(KINDS, key=lambda kind: self.probabilities[kind])


@dataclass(frozen=True, kw_only=True)
class NewObject:
    """Object of the new map, with the probability that it exists and is not in the old map."""

    object_id: int
    name: str
    probability: float
    position: Array  # (2,) in the old map's frame; (3,) in space


@dataclass(frozen=True, kw_only=True)
class MapDifference:
    """Changes of all objects with non-negligible existence."""

    old: tuple[OldObject, ...]
    new: tuple[NewObject, ...]
    T_old_new: Array  # (3,) x, y, yaw of the new map's frame in the old one's; in space (4,) x, y, z, yaw
    same_frame: bool  # else aligned by object correspondences
    alignment_probability: float
    shares_evidence: bool = False  # in part both maps state the same evidence, not two that agree


def difference(comparison: Comparison) -> MapDifference:
    """Evaluate all objects of a comparison."""
    return MapDifference(
        old=tuple(_old_object(comparison, row) for row in range(len(comparison.ours))),
        new=tuple(_new_object(comparison, column) for column in range(len(comparison.theirs))),
        T_old_new=comparison.best.alignment.T_old_new,
        same_frame=comparison.same_frame,
        alignment_probability=comparison.alignment_probability,
        shares_evidence=share_evidence(comparison.old, comparison.new),
    )


def gone(comparison: Comparison, row: int) -> tuple[float, float]:
    """Probabilities that an old object is gone, and that it is still there but unseen."""
    left, _ = _left_and_none(comparison, row)
    unseen = float(comparison.unseen[row])
    return left * (1.0 - unseen), left * unseen


def _left_and_none(comparison: Comparison, row: int) -> tuple[float, float]:
    """Probabilities that an old object exists without a counterpart, and that it never existed."""
    apart = max(1.0 - float(comparison.same[row].sum() + comparison.displaced[row].sum()), 0.0)
    exists = float(comparison.ours.existence[row])
    there = exists * GONE_SHARE / (1.0 - float(comparison.unseen[row]))
    none = apart * (1.0 - exists) / (1.0 - exists + there)
    return apart - none, none


def _old_object(comparison: Comparison, row: int) -> OldObject:
    same, displaced = float(comparison.same[row].sum()), float(comparison.displaced[row].sum())
    left, unseen = gone(comparison, row)
    _, none = _left_and_none(comparison, row)
    column = int(np.argmax(comparison.same[row] + comparison.displaced[row]))
    has_one = bool(comparison.same[row, column] + comparison.displaced[row, column] > 1.0 - same - displaced)
    distance, sigma = _distance(comparison, row, column) if has_one else (float("nan"), float("nan"))
    number = int(comparison.ours.rows[row])
    return OldObject(
        object_id=int(comparison.old.objects.ids[number]),
        name=comparison.old.objects.names[number],
        probabilities={"same": same, "displaced": displaced, "gone": left, "unseen": unseen, "none": none},
        new_id=int(comparison.new.objects.ids[comparison.theirs.rows[column]]) if has_one else None,
        distance_m=distance,
        sigma_m=sigma,
    )


def _distance(comparison: Comparison, row: int, column: int) -> tuple[float, float]:
    """Distance of two objects [m], and its standard deviation along the connecting line."""
    axes = slice(0, comparison.ours.frames.num_axes)
    pairs = comparison.best.pairs
    offset, spread = pairs.offset[row, column, axes], pairs.covariance[row, column, axes, axes]
    distance = float(np.linalg.norm(offset))
    along = offset / max(distance, 1e-9)
    return distance, float(np.sqrt(along @ spread @ along))


def _new_object(comparison: Comparison, column: int) -> NewObject:
    row = int(comparison.theirs.rows[column])
    apart = max(1.0 - float(comparison.same[:, column].sum() + comparison.displaced[:, column].sum()), 0.0)
    return NewObject(
        object_id=int(comparison.new.objects.ids[row]),
        name=comparison.new.objects.names[row],
        probability=apart * float(comparison.theirs.existence[column]),
        position=comparison.new_positions[column],
    )

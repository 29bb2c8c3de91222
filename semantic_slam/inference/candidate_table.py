"""One table of the candidates of all backends, before near-duplicates are merged and the rest is pruned."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.protocol import Candidates
from semantic_slam.inference.states.lineage import LineageStep


@dataclass(frozen=True, kw_only=True)
class CandidateTable:
    """K candidates of P parents, sorted by id and thus independent of which backend answered; D detections."""

    ids: NDArray[np.uint64]  # (K,)
    parent_ids: NDArray[np.uint64]  # (K,)
    associations: NDArray[np.int32]  # (K, D) object ids
    classes: NDArray[np.int32]  # (K, D)
    modes: NDArray[np.uint16]  # (K,)
    changes: NDArray[np.object_]  # (K,) reassociations of earlier detections, tuples of ``Reassigned``
    log_weights: Array  # (K,) w psi over all parents, not normalised
    innovation_nees: Array  # (K,) per degree of freedom, NaN without a detection of a known object
    outlier_probability: Array  # (K, D) that a detection is a geometric outlier of its object
    poses: Array  # (K, 7)
    object_poses: Array  # (K, D, 7)
    log_missing: Array  # (P,) mass that was not enumerated, in the same units

    @classmethod
    def of(cls, answers: Sequence[Candidates]) -> "CandidateTable":
        """Build the table from the answers of all backends; a hypothesis that several expanded counts once."""
        filled = [answer for answer in answers if len(answer.ids)] or answers[:1]  # without a row D is unknown
        ids, order = np.unique(np.concatenate([answer.ids for answer in filled]), return_index=True)
        parents = np.concatenate([answer.expanded_parent_ids for answer in answers])
        missing = np.concatenate([answer.log_mass_not_enumerated for answer in answers])
        return cls(
            ids=ids,
            parent_ids=np.concatenate([answer.parent_ids for answer in filled])[order],
            associations=np.concatenate([answer.associations for answer in filled])[order],
            classes=np.concatenate([answer.class_assignments for answer in filled])[order],
            modes=np.concatenate([answer.modes for answer in filled])[order],
            changes=_objects([own for answer in filled for own in answer.changes or [()] * len(answer.ids)])[order],
            log_weights=np.concatenate([answer.log_weights for answer in filled])[order],
            innovation_nees=np.concatenate([answer.innovation_nees for answer in filled])[order],
            outlier_probability=np.concatenate([answer.outlier_probability for answer in filled])[order],
            poses=np.concatenate([answer.poses for answer in filled])[order],
            object_poses=np.concatenate([answer.object_poses for answer in filled])[order],
            log_missing=missing[np.unique(parents, return_index=True)[1]],
        )

    def take(self, rows: Index, log_weights: Array) -> "CandidateTable":
        """The table of the chosen candidates, with new log weights."""
        others = [name for name in vars(self) if name not in ("log_weights", "log_missing")]
        return replace(self, **{name: getattr(self, name)[rows] for name in others}, log_weights=log_weights)

    @property
    def log_found(self) -> float:
        """Log ratio of the mass of all candidates to that of the unrevised ones; 0 if none or all are revised."""
        same = np.array([not own for own in self.changes], dtype=bool)
        if same.all() or not same.any():
            return 0.0
        return float(np.logaddexp.reduce(self.log_weights) - np.logaddexp.reduce(self.log_weights[same]))

    def step(self, row: int) -> LineageStep:
        """The lineage step of one candidate."""
        association, classes = self.associations[row].tolist(), self.classes[row].tolist()
        return LineageStep.of(association, classes, int(self.modes[row]), self.changes[row])


def _objects(values: Sequence[object]) -> NDArray[np.object_]:
    """(n,) array of objects: one tuple per entry, which numpy would otherwise unpack."""
    found = np.empty(len(values), dtype=object)
    for row, value in enumerate(values):
        found[row] = value
    return found

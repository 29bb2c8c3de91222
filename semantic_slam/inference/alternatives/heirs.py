"""Which surviving hypothesis is the heir of a pruned one: near in pose, and with the fewest different associations."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import PLANAR_AXES, planar_from_pose_vector, wrap_angle
from semantic_slam.inference.alternatives.differences import Change, differences
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.states.lineage import Lineage

FARTHEST = 3.0
"""Largest squared Mahalanobis distance of both robot poses, by the survivor's covariance: chi-square's mean, 3 dof."""


@dataclass
class Heirs:
    """K candidates of a keyframe, of which the H in ``rows`` survive; P parents by their ids."""

    weighed: CandidateTable
    rows: Index  # (H,) of the survivors
    covariances: Array  # (H, 6, 6) of the robot's pose
    parents: Mapping[int, Lineage]  # lineage of each parent
    _apart: dict[tuple[int, int], tuple[Change, ...]] = field(default_factory=dict)

    def of(self, row: int) -> tuple[int, tuple[Change, ...]] | None:
        """The heir of the candidate in ``row``: its index among the H, and the changes from the heir to the candidate.

        The heir is the survivor that differs in the fewest detections, and of those the heaviest. None: no survivor is
        near enough.
        """
        found = [(self._changes(row, int(at)), -self.weighed.log_weights[self.rows[at]], at) for at in self._near(row)]
        if not found:
            return None
        changes, _, heir = min(found, key=lambda own: (len(own[0]), own[1], own[2]))
        return int(heir), changes

    def _near(self, row: int) -> Index:
        """Indices of survivors whose robot is at about the same pose, with the same root (noise setting and start)."""
        offset = planar_from_pose_vector(self.weighed.poses[self.rows]) - self._planar(row)
        offset[:, 2] = wrap_angle(offset[:, 2])
        axes = np.array(PLANAR_AXES, dtype=int)
        spread = self.covariances[:, axes[:, None], axes]
        squared = (offset * np.linalg.solve(spread, offset[..., None])[..., 0]).sum(axis=1)
        near = np.flatnonzero(squared <= FARTHEST)
        return np.array([at for at in near if self._begins(self.rows[at]) == self._begins(row)], dtype=int)

    def _planar(self, row: int) -> Array:
        return np.asarray(planar_from_pose_vector(self.weighed.poses[row]))

    def _begins(self, row: int) -> int:
        lineage = self.parents[int(self.weighed.parent_ids[row])]
        return lineage[0].mode if lineage else int(self.weighed.modes[row])

    def _changes(self, row: int, at: int) -> tuple[Change, ...]:
        heir = int(self.rows[at])
        now = _newest(self.weighed.associations[heir], self.weighed.associations[row], self._keyframe(row))
        return self._between(int(self.weighed.parent_ids[heir]), int(self.weighed.parent_ids[row])) + now

    def _keyframe(self, row: int) -> int:
        return len(self.parents[int(self.weighed.parent_ids[row])])

    def _between(self, heir: int, other: int) -> tuple[Change, ...]:
        if heir == other:
            return ()
        if (heir, other) not in self._apart:
            self._apart[heir, other] = differences(self.parents[heir], self.parents[other])
        return self._apart[heir, other]


def _newest(told: NDArray[np.int32], other: NDArray[np.int32], keyframe: int) -> tuple[Change, ...]:
    return tuple((keyframe, int(detection), int(other[detection])) for detection in np.flatnonzero(told != other))

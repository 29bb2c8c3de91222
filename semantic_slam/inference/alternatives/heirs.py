"""Which surviving hypothesis is the heir of a pruned one: near in pose, and with the fewest different associations."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import PLANAR_AXES, planar_from_pose_vector, wrap_angle
from semantic_slam.inference.alternatives.differences import Change, differences
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.problem import Problem

FARTHEST = 3.0
"""Largest squared Mahalanobis distance of both robot poses, by the survivor's covariance: chi-square's mean, 3 dof."""


@dataclass
class Heirs:
    """K candidates of a keyframe, of which the H in ``rows`` survive; P parents by their ids."""

    problem: Problem
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
        near = self._near(row)
        if not len(near):
            return None
        survivors, other = self.rows[near], int(self.weighed.parent_ids[row])
        before = [len(self._between(heir, other)) for heir in self.weighed.parent_ids[survivors].tolist()]
        now = np.count_nonzero(self.weighed.associations[survivors] != self.weighed.associations[row], axis=1)
        best = np.lexsort((-self.weighed.log_weights[survivors], before + now))[0]  # of equal ones the first
        heir = int(near[best])
        return heir, self._changes(row, heir)

    def _near(self, row: int) -> Index:
        """Indices of survivors whose robot is at about the same pose, with the same root (noise setting and start)."""
        offset = self._poses - planar_from_pose_vector(self.weighed.poses[row])
        offset[:, 2] = wrap_angle(offset[:, 2])
        squared = (offset * np.linalg.solve(self._spreads, offset[..., None])[..., 0]).sum(axis=1)
        return np.flatnonzero((squared <= FARTHEST) & (self._root_numbers == self._root_number(row)))

    @cached_property
    def _poses(self) -> Array:
        """(H, 3) the survivors' robots in the plane."""
        return planar_from_pose_vector(self.weighed.poses[self.rows])

    @cached_property
    def _spreads(self) -> Array:
        """(H, 3, 3) their covariances."""
        axes = np.array(PLANAR_AXES, dtype=int)
        return self.covariances[:, axes[:, None], axes]

    @cached_property
    def _root_numbers(self) -> Index:
        """(H,) their root numbers."""
        return np.array([self._root_number(row) for row in self.rows.tolist()], dtype=int)

    def _root_number(self, row: int) -> int:
        lineage = self.parents[int(self.weighed.parent_ids[row])]
        return self.problem.root_number(lineage or (self.weighed.step(row),))

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

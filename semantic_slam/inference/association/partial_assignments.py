"""Partial associations (prefixes of a keyframe's detections), with their incrementally grown Cholesky factors.

The Cholesky factor of the states of a partial association grows by one block row per detection. That row is read from
the whitened cross covariance of those states with all objects, which grows along with it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Index, column_products
from semantic_slam.geometry.rows import take
from semantic_slam.geometry.small_matrices import forward
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem, PredictedBelief
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class PartialAssignments:
    """B partial associations of n detections; O objects, tangent spaces of r and l dimensions, m = r + n l."""

    spaces: Spaces
    predicted: PredictedBelief
    rows: Assignments
    mean: Array  # (B, 1 + n, s) prior of the robot and the associated objects
    root: Array  # (B, m, m) Cholesky factor of its covariance
    shorter: "PartialAssignments | None"  # the partial associations of one detection less; None: these have none
    origin: Index  # (B,) row of ``shorter`` that each one extends

    @classmethod
    def of_robots(cls, spaces: Spaces, predicted: PredictedBelief) -> "PartialAssignments":
        """The empty association of each parent: the robot alone."""
        size, parents = spaces.layout.robot, np.arange(len(predicted.mean))
        root = np.asarray(np.linalg.cholesky(predicted.covariance[:, :size, :size]), dtype=np.float64)
        rows = Assignments(parents=parents, objects=np.zeros((len(parents), 0), dtype=int))
        return cls(
            spaces=spaces,
            predicted=predicted,
            rows=rows,
            mean=predicted.mean[:, :1],
            root=root,
            shorter=None,
            origin=parents,
        )

    def take(self, selection: Index) -> "PartialAssignments":
        """The chosen partial assignments."""
        return take(self, selection, ("rows", "mean", "root", "origin"))

    def extended(self, origin: Index, objects: Index) -> "PartialAssignments":
        """K partial associations of one detection more, extending rows ``origin`` (K,) by ``objects`` (K,).

        An object that the prefix contains already, or clutter (-1), needs no state of its own: its block is an
        independent standard normal (a dummy).
        """
        parents, before = self.rows.parents[origin], self.rows.objects[origin]
        size, known, place = self.spaces.layout.landmark, self.root.shape[1], 1 + objects
        gain = np.ascontiguousarray(np.swapaxes(self.cross_blocks[origin, :, place, :size], 1, 2))  # (K, l, m)
        left = self.predicted.blocks[parents, place, :size, place, :size] - gain @ np.swapaxes(gain, 1, 2)
        again = (before == objects[:, None]).any(axis=1) | (objects < 0)
        gain[again], left[again] = 0.0, np.eye(size)
        root = np.zeros((len(origin), known + size, known + size))
        root[:, :known, :known], root[:, known:, :known] = self.root[origin], gain
        root[:, known:, known:] = np.linalg.cholesky(left)
        mean = self.predicted.mean[parents, np.where(again, 0, place)]
        return PartialAssignments(
            spaces=self.spaces,
            predicted=self.predicted,
            rows=Assignments(parents=parents, objects=np.concatenate([before, objects[:, None]], axis=1)),
            mean=np.concatenate([self.mean[origin], mean[:, None]], axis=1),
            root=root,
            shorter=self,
            origin=origin,
        )

    @cached_property
    def cross(self) -> Array:
        """(B, m, r + O l) whitened cross covariance: root @ cross is the covariance of these states with all states.

        It is computed lazily, only for the few partial associations that are extended.
        """
        layout, parents = self.spaces.layout, self.rows.parents
        if self.shorter is None:
            return forward(self.root, self.predicted.covariance[:, : layout.robot])
        before = self.shorter.cross[self.origin]
        known, objects = before.shape[1], self.rows.objects[:, -1]
        gain = np.ascontiguousarray(self.root[:, known:, :known])
        prior = layout.blocks(self.predicted.covariance, -2)[parents, 1 + objects][:, : layout.landmark]
        added = forward(self.root[:, known:, known:], prior - column_products(gain, before))
        added[(self.rows.objects[:, :-1] == objects[:, None]).any(axis=1) | (objects < 0)] = 0.0
        return np.concatenate([before, added], axis=1)

    @cached_property
    def cross_blocks(self) -> Array:
        """(B, m, 1 + O, w) whitened cross covariances :attr:`cross`, in blocks by state."""
        return self.spaces.layout.blocks(self.cross)

    def stack(self, model: ObservationModel, detections: object, log_clutter: Array | None = None) -> KeyframeProblem:
        """The estimation problems of these associations, over the robot and the objects of their n ``detections``.

        ``log_clutter`` (n,): log density of each detection as clutter.
        """
        return KeyframeProblem(self.spaces, model, detections, self.rows, self.mean, self.root, log_clutter)

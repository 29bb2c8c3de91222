"""Factors of semantic measurements, linearised in batches at an estimate: with classes, or with learned descriptors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.factor import exact_factor
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.linear_factors import linear_factors, linearisation_points
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.states.layout import Layout
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.latent.model import DescriptorBelief

MOVED_RAD = 0.1
"""Change of the direction of view [rad] from which on a linear factor is relinearised."""
MOVED_POSE = 0.3
"""Change of a pose [m or rad] from which on factors with descriptors are relinearised even where the view is unchanged:
GTSAM keeps a Jacobian in the frame where it was made, and a map that is not anchored must not be held in place by
that."""
MOVED_DESCRIPTOR = 0.2
"""Change of a descriptor component, in prior standard deviations, from which on linear factors are relinearised."""
RELINEARISED_DESCRIPTOR = 0.1
"""Change of a descriptor component, in prior standard deviations, from which on iSAM2 relinearises it."""


@dataclass(frozen=True, kw_only=True)
class SemanticFactor:
    """A semantic measurement under an enumerated class, or with a descriptor variable."""

    robot_key: int
    object_key: int
    detection: Any
    assigned_class: int  # -1 with a descriptor
    descriptor_key: int | None = None
    exact: bool = False  # nonlinear (callback), while the direction of view is uncertain

    @property
    def keys(self) -> tuple[int, ...]:
        """GTSAM keys of the robot, the object and, with a latent space, its descriptor."""
        poses = (self.robot_key, self.object_key)
        return poses if self.descriptor_key is None else (*poses, self.descriptor_key)


@dataclass(frozen=True)
class LinearisationPoints:
    """States of the variables of n semantic measurements: robot, object and, if there are any, descriptor."""

    states: Array  # (n, s + s + L)
    storage: Layout  # of robot and object

    @classmethod
    def of(cls, measurements: Sequence[SemanticFactor], states: Mapping[int, Array]) -> "LinearisationPoints":
        """Linearisation points from the state of every key."""
        rows = [np.concatenate([states[key] for key in item.keys]) for item in measurements]
        if not rows:
            return NO_POINTS
        sizes = (len(states[key]) for key in (measurements[0].robot_key, measurements[0].object_key))
        return cls(np.array(rows), Layout(*sizes))

    @classmethod
    def stacked(cls, robots: Array, objects: Array, descriptors: Array) -> "LinearisationPoints":
        """Linearisation points from (n, s) robots, (n, s) objects and (n, L) descriptors."""
        return cls(np.concatenate([robots, objects, descriptors], axis=1), Layout(robots.shape[1], objects.shape[1]))

    @classmethod
    def joined(cls, parts: Sequence["LinearisationPoints"]) -> "LinearisationPoints":
        """Concatenated linearisation points of several parts; parts without measurements are skipped."""
        some = [part for part in parts if len(part.states)]
        return cls(np.concatenate([part.states for part in some]), some[0].storage) if some else NO_POINTS

    @property
    def robots(self) -> Array:
        """(n, s) robot states of the linearisation points."""
        return self.states[:, self.storage.block(0)]

    @property
    def objects(self) -> Array:
        """(n, s) object states of the linearisation points."""
        return self.states[:, self.storage.block(1)]

    @property
    def descriptors(self) -> Array:
        """(n, L) descriptors of the linearisation points; L is 0 under classes."""
        return self.states[:, self.storage.size(1) :]

    def take(self, rows: Sequence[int] | NDArray[np.int_]) -> "LinearisationPoints":
        """Linearisation points of the chosen measurements."""
        return LinearisationPoints(self.states[rows], self.storage)

    def replaced(self, rows: Sequence[int], others: "LinearisationPoints") -> "LinearisationPoints":
        """The linearisation points with those of some measurements changed."""
        states = self.states.copy()
        states[rows] = others.states
        return LinearisationPoints(states, self.storage)


NO_POINTS = LinearisationPoints(np.zeros((0, 0)), Layout(0, 0))
"""Linearisation points of no measurement."""


@dataclass(frozen=True)
class SemanticFactorMaker:
    """Makes semantic factors; ``latent`` None: with classes instead of descriptors."""

    spaces: Spaces
    model: ObservationModel
    latent: LatentObservation | None = None

    @cached_property
    def descriptor_threshold(self) -> Array:
        """(L,) change of a descriptor from which on iSAM2 relinearises it; L is 0 without descriptors."""
        return RELINEARISED_DESCRIPTOR * self._prior_sigma

    @cached_property
    def _prior_sigma(self) -> Array:
        return self.latent.prior.sigma[0] if self.latent is not None else np.zeros(0)

    def descriptor_prior(self, object_id: int) -> DescriptorBelief:
        """Prior of the descriptor of one object, B = 1."""
        assert self.latent is not None
        return self.latent.prior_of(object_id)

    def make(
        self, measurements: Sequence[Sequence[SemanticFactor]], points: Sequence[LinearisationPoints]
    ) -> list[list[Any]]:
        """Factors of S sets of measurements, (n_s,) each at its own n_s points; one batched evaluation for all.

        Within one set a variable has one linearisation point, whichever measurement it is in.
        """
        every = [item for factor_set in measurements for item in factor_set]
        if not every:
            return [[] for _ in measurements]
        at = LinearisationPoints.joined(points)
        values = linearisation_points(
            self.spaces, [[item.keys for item in factor_set] for factor_set in measurements], at.states
        )
        repeated = [value for factor_set, value in zip(measurements, values, strict=True) for _ in factor_set]
        make = self._classed if self.latent is None else self._latent
        factors = iter(make(every, at, repeated))
        return [[next(factors) for _ in factor_set] for factor_set in measurements]

    def change(self, before: LinearisationPoints, now: LinearisationPoints) -> tuple[Array, NDArray[np.bool_]]:
        """(n,) distance from the linearisation points, 1 being the limit, and whether poses themselves moved that far.

        Poses that move together leave the view unchanged, as where the map is not anchored.
        """
        relative = (self.spaces.seen(at.robots, at.objects) for at in (before, now))
        change = np.asarray(self.model.view_change(*relative)) / MOVED_RAD
        if self.latent is None:
            return change, np.zeros(len(change), dtype=bool)
        poses = (self.spaces.storage.stacked(at.robots[:, None], at.objects[:, None]) for at in (before, now))
        floating = np.abs(self.spaces.joint.local(*poses)).max(axis=(1, 2)) / MOVED_POSE
        descriptors = np.abs(now.descriptors - before.descriptors) / (MOVED_DESCRIPTOR * self._prior_sigma)
        return np.maximum(np.maximum(change, floating), descriptors.max(axis=1)), floating > 1.0

    def _classed(
        self, measurements: Sequence[SemanticFactor], at: LinearisationPoints, points: Sequence[Any]
    ) -> list[Any]:
        detections = self.model.collect([item.detection for item in measurements])
        classes = np.array([item.assigned_class for item in measurements])
        part = self.model.semantics(detections, at.robots, at.objects, classes)
        jacobians = [part.jacobian_robot, part.jacobian_object]
        return linear_factors([item.keys for item in measurements], jacobians, part.residual, points)

    def _latent(
        self, measurements: Sequence[SemanticFactor], at: LinearisationPoints, points: Sequence[Any]
    ) -> list[Any]:
        assert self.latent is not None
        rows = [row for row, item in enumerate(measurements) if not item.exact]
        if len(rows) == len(measurements):
            return self._with_descriptors(measurements, at, points)
        factors = [
            exact_factor(self.latent, item.detection, item.keys) if item.exact else None for item in measurements
        ]
        if rows:
            linear = [measurements[row] for row in rows]
            made = self._with_descriptors(linear, at.take(rows), [points[row] for row in rows])
            for row, factor in zip(rows, made, strict=True):
                factors[row] = factor
        return factors

    def _with_descriptors(
        self, measurements: Sequence[SemanticFactor], at: LinearisationPoints, points: Sequence[Any]
    ) -> list[Any]:
        """Linear factors on robot, object and descriptor, one for each measurement."""
        assert self.latent is not None
        features = DetectionFeatures.of([item.detection for item in measurements])
        part = self.latent.linearise(features, at.robots, at.objects, at.descriptors)
        jacobians = [part.by_robot, part.by_object, part.by_descriptor]
        return linear_factors([item.keys for item in measurements], jacobians, part.residual, points)

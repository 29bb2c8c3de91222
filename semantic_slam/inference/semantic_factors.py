"""Factors of semantic measurements, made in batches at an estimate: under classes, or with learned descriptors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.latent_factor import exact_factor, linear_factors
from semantic_slam.inference.latent_observation import LatentObservation
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.observation import ObservationModel
from semantic_slam.inference.planar_detection import PlanarDetections
from semantic_slam.latent.model import DescriptorBelief

Array = NDArray[np.float64]
States = Mapping[int, Array]

DESCRIPTOR = "e"
"""Symbol of E(n), below those of objects and robots."""
MOVED_RAD = 0.1
"""Change of a view from which on its linear factor is made anew."""
MOVED_POSE = 0.3
"""Change of a pose, metres or radians, from which on those with descriptors are, even where the view remained the same:
GTSAM keeps a Jacobian in the frame where it was made, and a map that floats must not be held by that."""
MOVED_DESCRIPTOR = 0.2
"""Change of a descriptor's component, in standard deviations of its prior, from which on linear factors are."""
RELINEARISED_DESCRIPTOR = 0.1
"""Change, in the same unit, from which on iSAM2 relinearises it."""

_SYMBOL_BITS = 56


def is_descriptor(key: int) -> bool:
    """Whether a GTSAM key is some E(n)."""
    return key >> _SYMBOL_BITS == ord(DESCRIPTOR)


@dataclass(frozen=True)
class Named:
    """A semantic measurement under a class, or with a descriptor."""

    robot_key: int
    object_key: int
    detection: Any
    assigned_class: int  # -1 with a descriptor
    descriptor_key: int | None = None
    exact: bool = False  # a callback, while the direction of view is uncertain

    @property
    def keys(self) -> tuple[int, ...]:
        """Of its variables."""
        poses = (self.robot_key, self.object_key)
        return poses if self.descriptor_key is None else (*poses, self.descriptor_key)


@dataclass(frozen=True)
class Place:
    """Where a linear factor was made."""

    relative: Array  # (d,) the object as seen from the robot
    poses: Array  # (2, d) robot and object
    descriptor: Array  # (L,), of no components under a class


@dataclass(frozen=True)
class Made:
    """The factor of a semantic measurement."""

    named: Named
    index: int  # in iSAM2's list of factors
    place: Place


@dataclass(frozen=True)
class SemanticFactors:
    """Makes them; ``latent`` None: there are no descriptors."""

    manifold: Manifold
    model: ObservationModel
    latent: LatentObservation | None = None

    @cached_property
    def descriptor_threshold(self) -> Array:
        """(L,) change of a descriptor from which on it is linearised anew; of no components without descriptors."""
        return RELINEARISED_DESCRIPTOR * self._prior_sigma

    @cached_property
    def _prior_sigma(self) -> Array:
        return self.latent.prior.sigma[0] if self.latent is not None else np.zeros(0)

    def descriptor_prior(self, object_id: int) -> DescriptorBelief:
        """Of one object, B = 1."""
        assert self.latent is not None
        return self.latent.prior_of(object_id)

    def make(self, named: Sequence[Named], states: States) -> tuple[list[Any], list[Place]]:
        """Factors of (n,) measurements at ``states``, one evaluation for all of a kind, and where that was."""
        if not named:
            return [], []
        factors: list[Any] = [None] * len(named)
        of_class = [row for row, item in enumerate(named) if item.descriptor_key is None]
        of_descriptor = [row for row, item in enumerate(named) if item.descriptor_key is not None]
        for rows, make in ((of_class, self._classed), (of_descriptor, self._latent)):
            made = make([named[row] for row in rows], states) if rows else []
            for row, factor in zip(rows, made, strict=True):
                factors[row] = factor
        return factors, self._places(named, states)

    def moved(self, made: Sequence[Made], states: States) -> tuple[NDArray[np.bool_], bool]:
        """(n,) whether linear factors have to be made anew at ``states``, and whether the map floats there."""
        now = self._places([item.named for item in made], states)
        before = [item.place for item in made]
        relative = (np.array([place.relative for place in places]) for places in (before, now))
        moved = np.asarray(self.model.view_change(*relative) > MOVED_RAD)
        rows = [row for row, place in enumerate(before) if len(place.descriptor)]
        if not rows:
            return moved, False
        poses, descriptors = (
            [np.array([getattr(places[row], name) for row in rows]) for places in (before, now)]
            for name in ("poses", "descriptor")
        )
        floats = np.abs(self.manifold.local(*poses)).max(axis=(1, 2)) > MOVED_POSE
        change = np.abs(descriptors[1] - descriptors[0]) / self._prior_sigma
        moved[rows] |= floats | (change.max(axis=1) > MOVED_DESCRIPTOR)
        return moved, bool(floats.any())

    def _places(self, named: Sequence[Named], states: States) -> list[Place]:
        x, o = _poses(named, states)
        relative, poses = self.manifold.between(x, o), np.stack([x, o], axis=1)
        none = np.zeros(0)
        return [
            Place(own, pair, none if item.descriptor_key is None else states[item.descriptor_key])
            for own, pair, item in zip(relative, poses, named, strict=True)
        ]

    def _classed(self, named: Sequence[Named], states: States) -> list[Any]:
        keys = [(item.robot_key, item.object_key) for item in named]
        classes = np.array([item.assigned_class for item in named])
        detections = [item.detection for item in named]
        return self.model.semantic_factors(detections, keys, classes, *_poses(named, states))

    def _latent(self, named: Sequence[Named], states: States) -> list[Any]:
        assert self.latent is not None
        keys = [(item.robot_key, item.object_key, item.descriptor_key or 0) for item in named]
        x, o = _poses(named, states)
        e = np.array([states[key] for _, _, key in keys])
        part = self.latent.linearise(PlanarDetections.of([item.detection for item in named]), x, o, e)
        factors = linear_factors(part, keys, x, o, e)
        for row, item in enumerate(named):
            if item.exact:
                factors[row] = exact_factor(self.latent, item.detection, keys[row])
        return factors


def _poses(named: Sequence[Named], states: States) -> tuple[Array, Array]:
    """(n, d) robots and objects."""
    x = np.array([states[item.robot_key] for item in named])
    return x, np.array([states[item.object_key] for item in named])

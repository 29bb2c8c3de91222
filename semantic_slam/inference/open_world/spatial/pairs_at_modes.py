"""Detections that may be of objects whose range is hardly known: linearised where both agree, not at the prediction.

The direction from elsewhere of an object that may be near or far is no linear function of its range: a detection is
linearised at the mode of robot and object given both, in coordinates in which what is known is a Gaussian, pair by
pair. What weighs many detections together goes on from there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy, squared_norms
from semantic_slam.geometry.levenberg_marquardt import LevenbergMarquardt
from semantic_slam.inference.association.gating import PairDensities
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.observation import Innovation, Linearisation, ObservationModel
from semantic_slam.inference.states.range_chart import moved_and_slopes, relative_sigmas
from semantic_slam.inference.states.spaces import Spaces

LEAST_SIGMA = 0.1
"""Standard deviation of a range as a share of it below which a detection is linear enough at the prediction."""
MOST_STEPS, TOLERANCE = 6, 1e-2
"""Steps of a search, and the nats that its last one may be expected to bring."""
FIRST_STEPS, HOPELESS = 2, 50.0
"""Steps after which a pair that is still so many nats from agreeing is looked at no longer: no gate lets it in."""


def pairs_at_modes(
    spaces: Spaces,
    model: ObservationModel,
    detections: Sequence[Any],
    predicted: PredictedBelief,
    anchors: Array,
    pairs: PairDensities,
) -> PairDensities:
    """The ``pairs`` of one parent's detections and M objects, some linearised elsewhere.

    ``anchors`` (M, 3): from where objects were first seen along a ray alone; NaN of others.
    """
    joint, size = predicted.pair_covariances()[0], spaces.layout.robot
    objects = predicted.mean[0, 1:, : spaces.storage.landmark]
    known = np.isfinite(anchors).all(axis=1)
    wide = np.flatnonzero(known)
    wide = wide[relative_sigmas(anchors[wide], objects[wide], joint[wide, size:, size:]) > LEAST_SIGMA]
    if not len(wide) or not detections:
        return pairs
    numbers, columns = (own.ravel() for own in np.meshgrid(np.arange(len(detections)), wide, indexing="ij"))
    problem = PairProblem(
        spaces=spaces,
        model=model,
        detections=model.collect(detections).take(numbers),
        robot=predicted.mean[0, 0, : spaces.storage.robot],
        objects=objects[columns],
        anchors=anchors[columns],
        root=np.linalg.cholesky(joint[columns]),
    )
    y = problem.mode()
    return _with_parts(
        pairs, problem.linearised(y), joint[columns], (numbers, columns), (problem.root @ y[..., None])[..., 0]
    )


@dataclass(frozen=True, kw_only=True)
class PairProblem:
    """The energies of B pairs of a robot and an object, whitened by what is predicted of both."""

    spaces: Spaces
    model: ObservationModel
    detections: Any  # B
    robot: Array  # (s,)
    objects: Array  # (B, 3)
    anchors: Array  # (B, 3)
    root: Array  # (B, r + l, r + l)

    def select(self, selection: Index) -> "PairProblem":
        """The chosen pairs."""
        return replace(
            self,
            detections=self.detections.take(selection),
            objects=self.objects[selection],
            anchors=self.anchors[selection],
            root=self.root[selection],
        )

    def mode(self) -> Array:
        """(B, n) where each is found; of those that never agree, where the search was given up."""
        search = LevenbergMarquardt(self, np.zeros((len(self.objects), self.root.shape[-1])))
        search.advance(FIRST_STEPS, np.full(len(self.objects), TOLERANCE))
        y = search.y
        left = np.flatnonzero(search.energy + self.detections.log_normaliser < HOPELESS)
        y[left] = search.select(left).finished(MOST_STEPS - FIRST_STEPS, TOLERANCE).y
        return y

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, n) and Gauss-Newton Hessian (B, n, n)."""
        part = self._part((self.root @ y[..., None])[..., 0])
        jacobian = _jacobian(part) @ self.root
        energy = 0.5 * (squared_norms(part.residual) + squared_norms(y)) - part.log_normaliser
        gradient = y + (np.swapaxes(jacobian, 1, 2) @ part.residual[..., None])[..., 0]
        return energy, gradient, np.eye(y.shape[1]) + np.swapaxes(jacobian, 1, 2) @ jacobian

    def linearised(self, y: Array) -> Linearisation:
        """The detections as linear functions of robot and object about the prediction, made at ``y`` (B, n)."""
        tangent = (self.root @ y[..., None])[..., 0]
        part = self._part(tangent)
        return replace(part, residual=part.residual - (_jacobian(part) @ tangent[..., None])[..., 0])

    def _part(self, tangent: Array) -> Linearisation:
        """With derivatives by what leads from the prediction."""
        size, space = self.spaces.layout.robot, self.spaces.robot
        robots = broadcast_copy(self.robot, (len(tangent), len(self.robot)))
        step, chart = space.exp_and_jacobian(tangent[:, :size])
        objects, slopes = moved_and_slopes(self.anchors, self.objects, tangent[:, size:])
        part = self.model.geometry(self.detections, space.compose(robots, step), objects)
        return replace(part, jacobian_robot=part.jacobian_robot @ chart, jacobian_object=part.jacobian_object @ slopes)


def _jacobian(part: Linearisation) -> Array:
    return np.concatenate([part.jacobian_robot, part.jacobian_object], axis=-1)


def _with_parts(
    pairs: PairDensities, part: Linearisation, joint: Array, at: tuple[Index, Index], points: Array
) -> PairDensities:
    """Pairs ``at`` (B,) detections and (B,) objects replaced, linearised at tangent vectors ``points`` (B, r + l)."""
    innovation = Innovation.of(part, _jacobian(part), joint)
    density, distance = pairs.log_density.copy(), pairs.distance.copy()
    density[at], distance[at] = innovation.log_density, innovation.distance
    parts = [replace(own, **{name: values.copy() for name, values in vars(own).items()}) for own in pairs.parts]
    for row, (number, column) in enumerate(zip(*at, strict=True)):
        for name, values in vars(part).items():
            getattr(parts[number], name)[column] = values[row]
    shape = density.shape
    offsets = np.zeros((*shape, part.residual.shape[1]))
    offsets[at] = (_jacobian(part) @ points[..., None])[..., 0]
    elsewhere: Flags = np.zeros(shape, dtype=bool)
    elsewhere[at] = True
    return PairDensities(density, distance, parts, offsets, elsewhere)

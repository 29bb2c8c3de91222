"""Robot, objects and descriptors of many continuations given their geometric posterior: B least-squares problems.

The geometric posterior of continuation b is the Gaussian at its mode, and the descriptors are jointly Gaussian with it.
In v ~ N(0, I) tangent vectors and descriptors are linear, t = t* + T v and e = e* + D v, so that the evidence of the
features is the integral of N(v; 0, I) N(f; mu(x, o, e), Sigma), computed by a damped Laplace approximation, and where
descriptors are hardly known by ``descriptor_posterior``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.rows import take
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import (
    LatentLinearisation,
    LatentObservation,
    azimuth_slopes,
)
from semantic_slam.inference.models.planar.frames import camera_in_object
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class DescriptorProblem:
    """B continuations of n detections; V coordinates, r and l tangent dimensions, w the wider of both."""

    spaces: Spaces
    observation: LatentObservation
    seen: DetectionFeatures  # n
    active: NDArray[np.bool_]  # (B, n)
    slots: Index  # (B, n) block of the object of each detection
    mean: Array  # (B, 1 + n, s) base points of tangent vectors
    offset: Array  # (B, r + n l + n L) t*, e*
    gain: Array  # (B, r + n l + n L, V) T, D

    @property
    def num_tangent(self) -> int:
        """r + n l, the number of tangent coordinates of robot and objects."""
        return self.spaces.layout.size(self.active.shape[1])

    def select(self, selection: Index) -> "DescriptorProblem":
        """The chosen problems of the batch."""
        return take(self, selection, ("active", "slots", "mean", "offset", "gain"))

    def descriptors(self, v: Array) -> Array:
        """(B, n, L) descriptors at whitened variables ``v``."""
        flat = self._variables(v)[:, self.num_tangent :]
        return flat.reshape(len(v), self.active.shape[1], -1)

    def states(self, v: Array) -> Array:
        """(B, 1 + n, s) states of robot and objects at whitened variables ``v``."""
        return self.spaces.joint.retract(self.mean, self._tangent(v))

    def energies(self, v: Array) -> Array:
        """(B, n) -log N(f; mu, Sigma) of each detection, 0 for clutter."""
        part, _ = self._parts(v)
        return self._by_row(-part.log_density())

    def normal_equations(self, v: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, V) and Gauss-Newton Hessian (B, V, V)."""
        part, chart = self._parts(v)
        residual = self._by_row(part.residual).reshape(len(v), -1)
        energy = 0.5 * (v**2).sum(-1) + self._by_row(-part.log_density()).sum(-1)
        jacobian = self._placed(part, chart) @ self.gain
        transposed = np.swapaxes(jacobian, 1, 2)
        gradient = v + (transposed @ residual[..., None])[..., 0]
        return energy, gradient, np.eye(v.shape[1]) + transposed @ jacobian

    def azimuths(self, v: Array) -> Array:
        """(B, n) directions [rad] from objects to the camera, in the objects' frames."""
        x, o, _, _ = self._placed_states(v)
        towards = camera_in_object(x, o, np.tile(self.seen.sensor, (len(v), 1)))
        return np.arctan2(towards[:, 1], towards[:, 0]).reshape(self.active.shape)

    def azimuth_gain(self, v: Array) -> Array:
        """(B, n, V) Jacobian of the direction of view by v."""
        x, o, _, chart = self._placed_states(v)
        batch, count = self.active.shape
        turn = self._by_row(azimuth_slopes(x, o, np.tile(self.seen.sensor, (batch, 1))))
        layout = self.spaces.layout
        placed, split = np.zeros((batch, count, 1 + count, layout.width)), layout.robot
        placed[:, :, 0, :split] = turn[:, :, :split]
        placed[np.arange(batch)[:, None], np.arange(count), 1 + self.slots, : layout.landmark] = turn[:, :, split:]
        by_tangent = layout.joined(np.einsum("bncd,bcde->bnce", placed, chart))
        return np.asarray(by_tangent @ self.gain[:, : self.num_tangent])

    def _variables(self, v: Array) -> Array:
        return np.asarray(self.offset + (self.gain @ v[..., None])[..., 0])

    def _tangent(self, v: Array) -> Array:
        return self.spaces.layout.blocks(self._variables(v)[:, : self.num_tangent])

    def _parts(self, v: Array) -> tuple[LatentLinearisation, Array]:
        """Linearised features of all detections of all rows, (B n), and (B, 1 + n, w, w) retraction Jacobians."""
        x, o, e, chart = self._placed_states(v)
        batch, count = self.active.shape
        part = self.observation.linearise(self.seen.take(np.tile(np.arange(count), batch)), x, o, e)
        return part, chart

    def _placed_states(self, v: Array) -> tuple[Array, Array, Array, Array]:
        """(B n, s) robots and objects and (B n, L) descriptors of all detections, and the retraction Jacobians."""
        batch, count = self.active.shape
        rows = np.arange(batch)[:, None]
        variables = self._variables(v)
        joint, storage = self.spaces.joint, self.spaces.storage
        moved, chart = joint.exp_and_jacobian(self.spaces.layout.blocks(variables[:, : self.num_tangent]))
        states = joint.compose(self.mean, moved)
        x = np.repeat(states[:, 0, : storage.robot], count, axis=0)
        o = states[rows, 1 + self.slots, : storage.landmark].reshape(len(x), -1)
        e = variables[:, self.num_tangent :].reshape(batch, count, -1)[rows, self.slots].reshape(len(x), -1)
        return x, o, e, chart

    def _by_row(self, values: Array) -> Array:
        """(B n, ...) values of the detections to (B, n, ...), 0 for clutter."""
        shaped = values.reshape(*self.active.shape, *values.shape[1:])
        return np.where(self.active.reshape(*self.active.shape, *(1,) * (values.ndim - 1)), shaped, 0.0)

    def _placed(self, part: LatentLinearisation, chart: Array) -> Array:
        """(B, n F, r + n l + n L) Jacobians by tangent vectors and descriptors."""
        batch, count = self.active.shape
        size, length = part.residual.shape[1], self.observation.num_dimensions
        rows, numbers = np.arange(batch)[:, None], np.arange(count)
        layout, r, own = self.spaces.layout, self.spaces.layout.robot, slice(self.spaces.layout.landmark)
        poses = np.zeros((batch, count, size, 1 + count, layout.width))
        poses[:, :, :, 0, :r] = self._by_row(part.by_robot) @ chart[:, None, 0, :r, :r]
        poses[rows, numbers, :, 1 + self.slots, own] = (
            self._by_row(part.by_object) @ chart[rows, 1 + self.slots, own, own]
        )
        latent = np.zeros((batch, count, size, count, length))
        latent[rows, numbers, :, self.slots] = self._by_row(part.by_descriptor)
        flat = (batch, count * size, -1)
        return np.concatenate([layout.joined(poses).reshape(flat), latent.reshape(flat)], axis=2)

"""A hypothesis from the last keyframe at which it was Gaussian: robot states since, and the objects seen since.

The states are x_a = mean Exp(L y_a), o = mean Exp(L y_o) and x_t = x_(t-1) u_t Exp(M_t y_t), so that y ~ N(0, I)
exactly and the evidence of everything since is the mean of the likelihood over y: Eq. 4.18 for the whole history.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from semantic_slam.inference.component import Motion
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.observation import Detections, Linearisation, ObservationModel

Array = NDArray[np.float64]
Index = NDArray[np.int_]


@dataclass(frozen=True)
class Seen:
    """A detection under a hypothesis."""

    detection: Any
    place: int  # of its object among the chain's
    assigned_class: int  # -1: no semantics


@dataclass(frozen=True)
class Link:
    """What one keyframe adds to a chain."""

    motion: Motion
    seen: tuple[Seen, ...]


class Chain:
    """The energy -log p(Z | y) + |y|^2 / 2 of T keyframes after the anchor, over the robot and O objects.

    The blocks of y: robot and objects at the anchor, then the T motions; ``size`` = (1 + O + T) d numbers.
    """

    def __init__(
        self, manifold: Manifold, model: ObservationModel, mean: Array, covariance: Array, links: Sequence[Link]
    ):
        """``mean`` (1 + O, d), the robot's first, and ``covariance`` ((1 + O) d, (1 + O) d) of the anchor."""
        self.manifold, self.model, self.links = manifold, model, tuple(links)
        self.mean, self.dimension = mean, manifold.dimension
        self.root = np.linalg.cholesky(covariance)
        self.motion_roots = [np.linalg.cholesky(link.motion.covariance) for link in links]
        self.size = self.root.shape[0] + len(links) * self.dimension
        self.sights = [(t + 1, seen) for t, link in enumerate(links) for seen in link.seen]
        self._seen = model.collect([seen.detection for _, seen in self.sights])
        self._times = np.array([t for t, _ in self.sights], dtype=int)
        self._places = np.array([seen.place for _, seen in self.sights], dtype=int)
        self._classes = np.array([seen.assigned_class for _, seen in self.sights], dtype=int)

    def select(self, selection: Any) -> "Chain":
        """Itself: one chain serves every row of y."""
        return self

    def coordinates(self, robots: Array, objects: Array) -> Array:
        """(size,) y of robot states (1 + T, d), the anchor's first, and objects (O, d)."""
        anchor = self.manifold.local(self.mean, np.concatenate([robots[:1], objects]))
        blocks = [solve_triangular(self.root, anchor.ravel(), lower=True)]
        for before, after, link, root in zip(robots[:-1], robots[1:], self.links, self.motion_roots, strict=True):
            moved = self.manifold.compose(before, link.motion.control)
            blocks.append(solve_triangular(root, self.manifold.local(moved, after), lower=True))
        return np.concatenate(blocks)

    def newest_slopes(self, y: Array) -> Array:
        """(1 + O, d, size) derivatives of the newest robot state and of the objects by y (size,)."""
        by_robot, by_object = self._slopes(self._states(y[None])[2])
        return np.concatenate([by_robot[:, -1], by_object[0]])

    def states(self, y: Array) -> tuple[Array, Array]:
        """(B, 1 + T, d) robot, the anchor's first, and (B, O, d) objects."""
        robots, objects, _ = self._states(y)
        return robots, objects

    def log_likelihood(self, y: Array) -> Array:
        """(B,) log P(Z | y)."""
        total = np.zeros(len(y))
        for part, _ in self._parts(*self.states(y)):
            total += (part.log_normaliser - 0.5 * (part.residual**2).sum(-1)).reshape(len(y), -1).sum(-1)
        return total

    def log_visibility(self, y: Array, *, soft: bool) -> Array:
        """(B,) log P(beta | x, O) of every keyframe since the anchor."""
        if not self.sights:
            return np.zeros(len(y))
        x, o = self._pairs(*self.states(y), np.arange(len(self.sights)))
        return np.asarray(self.model.log_visibility(x, o, soft=soft).reshape(len(y), -1).sum(-1))

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, size) and Gauss-Newton Hessian (B, size, size) in y."""
        robots, objects, tangents = self._states(y)
        by_robot, by_object = self._slopes(tangents)
        energy, gradient = 0.5 * (y**2).sum(-1), y.copy()
        hessian = np.broadcast_to(np.eye(self.size), (len(y), self.size, self.size)).copy()
        for part, sights in self._parts(robots, objects):
            shape = (len(y), len(sights), -1, self.dimension)
            jacobian = part.jacobian_robot.reshape(shape) @ by_robot[:, self._times[sights]]
            jacobian += part.jacobian_object.reshape(shape) @ by_object[:, self._places[sights]]
            jacobian = jacobian.reshape(len(y), -1, self.size)
            transposed = np.swapaxes(jacobian, -1, -2)
            energy += (0.5 * (part.residual**2).sum(-1) - part.log_normaliser).reshape(len(y), -1).sum(-1)
            gradient += (transposed @ part.residual.reshape(len(y), -1, 1))[..., 0]
            hessian += transposed @ jacobian
        return energy, gradient, hessian

    def energy(self, y: Array) -> Array:
        """(B,) -log P(Z | y) + |y|^2 / 2."""
        return np.asarray(0.5 * (y**2).sum(-1) - self.log_likelihood(y))

    def _pairs(self, robots: Array, objects: Array, sights: Index) -> tuple[Array, Array]:
        """(B S, d) robot and object of S sights."""
        x, o = robots[:, self._times[sights]], objects[:, self._places[sights]]
        return x.reshape(-1, self.dimension), o.reshape(-1, self.dimension)

    def _parts(self, robots: Array, objects: Array) -> list[tuple[Linearisation, Index]]:
        """Geometry of all sights and semantics of those with a class, and which they are."""
        everything = np.arange(len(self.sights))
        if not len(everything):
            return []
        parts = [(self.model.geometry(*self._repeated(robots, objects, everything)), everything)]
        named = np.flatnonzero(self._classes >= 0)
        if len(named):
            classes = np.tile(self._classes[named], len(robots))
            parts.append((self.model.semantics(*self._repeated(robots, objects, named), classes), named))
        return parts

    def _repeated(self, robots: Array, objects: Array, sights: Index) -> tuple[Detections, Array, Array]:
        return self._seen.take(np.tile(sights, len(robots))), *self._pairs(robots, objects, sights)

    def _states(self, y: Array) -> tuple[Array, Array, list[Array]]:
        """Robot and objects, and the tangents: of the anchor (B, 1 + O, d), then of each motion (B, d)."""
        width = self.root.shape[0]
        anchor = (y[:, :width] @ self.root.T).reshape(-1, *self.mean.shape)
        states = self.manifold.retract(np.broadcast_to(self.mean, anchor.shape), anchor)
        robots, tangents = [states[:, 0]], [anchor]
        for t, (link, root) in enumerate(zip(self.links, self.motion_roots, strict=True)):
            tangent = y[:, width + t * self.dimension : width + (t + 1) * self.dimension] @ root.T
            moved = self.manifold.compose(robots[-1], np.broadcast_to(link.motion.control, tangent.shape))
            robots.append(self.manifold.retract(moved, tangent))
            tangents.append(tangent)
        return np.stack(robots, axis=1), states[:, 1:], tangents

    def _slopes(self, tangents: list[Array]) -> tuple[Array, Array]:
        """(B, 1 + T, d, size) of the robot, (B, O, d, size) of the objects: derivatives in tangent spaces by y."""
        width, d = self.root.shape[0], self.dimension
        count = len(tangents[0])
        chart = self.manifold.retract_jacobian(tangents[0])
        anchor = np.zeros((count, len(self.mean), d, self.size))
        anchor[..., :width] = chart @ self.root.reshape(len(self.mean), d, width)
        robots = np.zeros((count, 1 + len(self.links), d, self.size))
        robots[:, 0] = anchor[:, 0]
        for t, (link, root) in enumerate(zip(self.links, self.motion_roots, strict=True)):
            moved = self.manifold.retract(np.zeros(d), tangents[t + 1])
            transition = self.manifold.propagation(moved) @ self.manifold.propagation(link.motion.control)
            robots[:, t + 1] = transition @ robots[:, t]
            columns = slice(width + t * d, width + (t + 1) * d)
            robots[:, t + 1, :, columns] += self.manifold.retract_jacobian(tangents[t + 1]) @ root
        return robots, anchor[:, 1:]

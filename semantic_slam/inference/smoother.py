"""The iSAM2 of a component: forked, updated until it has converged, optimised as a whole where updates cannot.

Semantic factors are linear (a callback into Python costs sixty times as much): they are made at an estimate, and all
of them anew when an object has moved from where they were made.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.observation import ObservationModel

Array = NDArray[np.float64]

MAX_UPDATES = 8
CONVERGED = 1e-4
"""Largest change of a state of this keyframe, metres or radians, after which an update counts as converged."""
RELINEARIZE_THRESHOLD = 0.02
WILDFIRE_THRESHOLD = 1e-9
"""Back-substitution goes on until changes are below this, so that estimates are those of the whole system."""
MOVED = 0.1
"""Change of an object's state, metres or radians, from which on linear factors are made anew."""
SAME = 1e-3
"""Change of a state, metres or radians, below which linear factors need not be made again in an optimisation."""
MAX_ROUNDS = 6
STEPPED_SKIP, STEPPED_THRESHOLD, STEPPED_WILDFIRE = 10, 0.1, 5e-3
"""Where updates are not iterated: keyframes from one relinearisation to the next, and metres or radians."""


class LostComponentError(SemanticSlamError):
    """A component's linear system is indeterminate; its hypothesis has to be given up."""


@dataclass(frozen=True)
class Named:
    """A semantic measurement under a class."""

    robot_key: int
    object_key: int
    detection: Any
    assigned_class: int


@dataclass(frozen=True)
class Smoother:
    """iSAM2, the semantic measurements in it, and where the objects were when their linear factors were made."""

    manifold: Manifold
    model: ObservationModel
    isam: gtsam.ISAM2
    named: tuple[Named, ...] = ()
    references: tuple[tuple[int, Array], ...] = ()  # object key, state

    @classmethod
    def of(
        cls, manifold: Manifold, model: ObservationModel, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values
    ) -> "Smoother":
        """A new one."""
        isam = _new_isam()
        isam.update(graph, values)
        return cls(manifold, model, isam)

    def states(self, keys: Sequence[int]) -> Array:
        """(n, d) estimates of different keys."""
        if not len(keys):
            return np.zeros((0, self.manifold.dimension))
        ascending = self.manifold.states(self.isam.calculateEstimate(list(keys)))
        return ascending[np.argsort(np.argsort(keys))]

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """(n d, n d) marginal covariance in the order of ``keys``, in the tangent spaces at the estimate."""
        try:
            covariance = self.isam.jointMarginalCovariance(list(keys)).fullMatrix()
        except (RuntimeError, IndexError) as fault:
            raise LostComponentError(f"marginals are not to be had ({_first_line(fault)})") from None
        return np.asarray(0.5 * (covariance + covariance.T))

    def covariances(self, keys: Sequence[int]) -> Array:
        """(n, d, d) marginal covariances, in the tangent spaces at the estimate. Raises LostComponentError."""
        try:
            blocks = [self.isam.marginalCovariance(key) for key in keys]
        except (RuntimeError, IndexError) as fault:
            raise LostComponentError(f"marginals are not to be had ({_first_line(fault)})") from None
        return np.array(blocks).reshape(len(keys), self.manifold.dimension, self.manifold.dimension)

    def extended(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        named: Sequence[Named],
        start: dict[int, Array],
        jumped: bool,
    ) -> "Smoother":
        """A fork with the factors of ``graph`` and those of ``named``, made at ``start`` (key -> (d,) state).

        Where the estimate ``jumped`` to ``start``, or does not settle, the whole is optimised from there. Raises
        LostComponentError when the system is indeterminate.
        """
        keys = [key for key in start if values.exists(key) or self.isam.valueExists(key)]
        known = dict(self.references)
        for item in named:
            known.setdefault(item.object_key, start[item.object_key])
        for factor in _linear(self.model, named, start):
            graph.add(factor)
        fork = Smoother(self.manifold, self.model, gtsam.ISAM2(self.isam), (*self.named, *named), tuple(known.items()))
        try:
            fork.isam.update(graph, values)
            if not jumped and fork._settled(keys) and not fork._moved(keys):
                return fork
            return fork._optimised(start)
        except RuntimeError as fault:
            raise LostComponentError(f"an update failed ({_first_line(fault)})") from None

    def stepped(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        named: Sequence[Named],
        start: dict[int, Array],
        *,
        in_place: bool,
        again: bool,
    ) -> "Smoother":
        """One update, two where ``again``, without waiting until it settles; ``in_place`` uses up this smoother.

        Semantic factors stay where they are made. Raises LostComponentError when the system is indeterminate.
        """
        for factor in _linear(self.model, named, start):
            graph.add(factor)
        isam = self.isam if in_place else gtsam.ISAM2(self.isam)
        try:
            isam.update(graph, values)
            if again:
                isam.update(force_relinearize=True)
        except RuntimeError as fault:
            raise LostComponentError(f"an update failed ({_first_line(fault)})") from None
        return replace(self, isam=isam, named=(*self.named, *named))

    def with_single_steps(self) -> "Smoother":
        """The same system, to be updated once per keyframe: relinearised seldom, back-substituted to millimetres."""
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = STEPPED_SKIP
        parameters.setRelinearizeThreshold(STEPPED_THRESHOLD)
        parameters.enablePartialRelinearizationCheck = True
        solver = gtsam.ISAM2GaussNewtonParams()
        solver.setWildfireThreshold(STEPPED_WILDFIRE)
        parameters.setOptimizationParams(solver)
        isam = gtsam.ISAM2(parameters)
        isam.update(self.isam.getFactorsUnsafe(), self.isam.getLinearizationPoint())
        return replace(self, isam=isam)

    def _settled(self, keys: list[int]) -> bool:
        before = self.states(keys)
        for _ in range(MAX_UPDATES):
            self.isam.update()
            after = self.states(keys)
            if np.abs(self.manifold.local(before, after)).max() < CONVERGED:
                return True
            before = after
        return False

    def _moved(self, keys: Sequence[int]) -> bool:
        """Whether one of these objects is not where its linear factors were made."""
        made = [(key, state) for key, state in self.references if key in keys]
        if not made:
            return False
        now = self.states([key for key, _ in made])
        return bool(np.abs(self.manifold.local(np.array([state for _, state in made]), now)).max() > MOVED)

    def _optimised(self, start: dict[int, Array]) -> "Smoother":
        """A new iSAM2 at the Levenberg-Marquardt optimum next to ``start``, its linear factors made there."""
        values = self.isam.calculateEstimate()
        for key, state in start.items():
            values.erase(key)
            self.manifold.insert(values, key, state)
        kept = self._nonlinear()
        for _ in range(MAX_ROUNDS):
            graph, made = gtsam.NonlinearFactorGraph(kept), _all_states(self.manifold, values, self.named)
            for factor in _linear(self.model, self.named, made):
                graph.add(factor)
            values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
            found = _all_states(self.manifold, values, self.named)
            if all(np.abs(self.manifold.local(made[key], found[key])).max() < SAME for key in made):
                break
        isam = _new_isam()
        isam.update(graph, values)
        objects = dict.fromkeys(item.object_key for item in self.named)
        return Smoother(self.manifold, self.model, isam, self.named, tuple((key, made[key]) for key in objects))

    def _nonlinear(self) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph(self.isam.getFactorsUnsafe())
        kept = gtsam.NonlinearFactorGraph()
        for factor in (graph.at(i) for i in range(graph.size())):
            if not isinstance(factor, gtsam.LinearContainerFactor):
                kept.add(factor)
        return kept


def _linear(model: ObservationModel, named: Sequence[Named], states: dict[int, Array]) -> list[Any]:
    """Linear semantic factors at the states of their keys."""
    if not named:
        return []
    keys = [(item.robot_key, item.object_key) for item in named]
    x, o = (np.array([states[pair[side]] for pair in keys]) for side in (0, 1))
    classes = np.array([item.assigned_class for item in named])
    return model.semantic_factors([item.detection for item in named], keys, classes, x, o)


def _all_states(manifold: Manifold, values: gtsam.Values, named: Sequence[Named]) -> dict[int, Array]:
    keys = {key for item in named for key in (item.robot_key, item.object_key)}
    return {key: manifold.state(values, key) for key in sorted(keys)}


def _new_isam() -> gtsam.ISAM2:
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    parameters.setRelinearizeThreshold(RELINEARIZE_THRESHOLD)
    solver = gtsam.ISAM2GaussNewtonParams()
    solver.setWildfireThreshold(WILDFIRE_THRESHOLD)
    parameters.setOptimizationParams(solver)
    return gtsam.ISAM2(parameters)


def _first_line(fault: BaseException) -> str:
    return next((line for line in str(fault).splitlines() if line.strip()), type(fault).__name__)

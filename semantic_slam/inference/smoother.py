"""The iSAM2 of a component: forked, updated until it has converged, optimised as a whole where updates cannot.

Semantic factors are linear (a callback into Python costs sixty times as much): they are made at an estimate, and those
of an object that a keyframe observes are made anew where its view has changed.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.observation import ObservationModel

Array = NDArray[np.float64]

MAX_UPDATES = 8
WILDFIRE_THRESHOLD = 1e-9
"""Back-substitution goes on until changes are below this, so that estimates are those of the whole system."""
MOVED = 0.1
"""Change of a view, radians, from which on its linear factor is made anew."""
SAME = 1e-3
"""Change of a state, metres or radians, below which linear factors need not be made again in an optimisation."""
MAX_ROUNDS = 6
MOST_JOINT = 24
"""States up to which their joint covariance costs less than those of single states."""
SYMBOL_BITS = 56
"""Of a key, before its letter."""
STEPPED_SKIP, STEPPED_THRESHOLD, STEPPED_WILDFIRE = 10, 0.1, 5e-3
"""Where updates are not iterated: keyframes from one relinearisation to the next, change of a state from which on it
takes part, and change below which back-substitution stops, metres or radians."""


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
class Made:
    """The linear factor of a semantic measurement."""

    named: Named
    index: int  # in iSAM2's list of factors
    relative: Array  # (d,) the object as seen from the robot where it was made


@dataclass(frozen=True)
class Smoother:
    """iSAM2 and the semantic measurements in it."""

    manifold: Manifold
    model: ObservationModel
    isam: gtsam.ISAM2
    made: tuple[Made, ...] = ()
    _known: dict[tuple[int, ...], Array] = field(default_factory=dict, compare=False, repr=False)

    @classmethod
    def of(
        cls, manifold: Manifold, model: ObservationModel, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values
    ) -> "Smoother":
        """A new one."""
        isam = _new_isam(manifold)
        isam.update(graph, values)
        return cls(manifold, model, isam)

    def states(self, keys: Sequence[int]) -> Array:
        """(n, d) estimates of different keys."""
        if not len(keys):
            return np.zeros((0, self.manifold.dimension))
        ascending = self.manifold.states(self.isam.calculateEstimate(list(keys)))
        return ascending[np.argsort(np.argsort(keys))]

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """(n d, n d) marginal covariance in the order of ``keys``, in the tangent spaces at the estimate.

        Read once: a report and the prediction after it ask for the same. Raises LostComponentError.
        """
        wanted = tuple(keys)
        if wanted not in self._known:
            try:
                covariance = self.isam.jointMarginalCovariance(list(keys)).fullMatrix()
            except (RuntimeError, IndexError) as fault:
                raise LostComponentError(f"marginals are not to be had ({_first_line(fault)})") from None
            self._known[wanted] = np.asarray(0.5 * (covariance + covariance.T))
        return self._known[wanted].copy()

    def covariances(self, keys: Sequence[int]) -> Array:
        """(n, d, d) marginal covariances, in the tangent spaces at the estimate. Raises LostComponentError."""
        size = self.manifold.dimension
        try:
            return np.array([self.isam.marginalCovariance(key) for key in keys]).reshape(len(keys), size, size)
        except (RuntimeError, IndexError) as fault:
            raise LostComponentError(f"marginals are not to be had ({_first_line(fault)})") from None

    def joint_blocks(self, keys: Sequence[int]) -> Array:
        """The same of keys whose joint covariance the next prediction asks for, unless they are many."""
        count, size = len(keys), self.manifold.dimension
        if count > MOST_JOINT:
            return self.covariances(keys)
        blocks = self.joint_covariance(keys).reshape(count, size, count, size)
        return blocks[np.arange(count), :, np.arange(count)]

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
        try:
            fork = self._updated(gtsam.ISAM2(self.isam), graph, values, named, start)
            settled = None if jumped else fork._settled(start)
            return fork._optimised(start) if settled is None else settled
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

        Semantic factors stay as they are made. Raises LostComponentError when the system is indeterminate.
        """
        isam = self.isam if in_place else gtsam.ISAM2(self.isam)
        try:
            child = self._updated(isam, graph, values, named, start)
            if again:
                isam.update(force_relinearize=True)
        except RuntimeError as fault:
            raise LostComponentError(f"an update failed ({_first_line(fault)})") from None
        return child

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
        return Smoother(self.manifold, self.model, isam, self.made)

    def _updated(
        self,
        isam: gtsam.ISAM2,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        named: Sequence[Named],
        states: dict[int, Array],
    ) -> "Smoother":
        """``isam`` after one update, with linear factors made at ``states``."""
        factors, relatives = self._linear(named, states)
        for factor in factors:
            graph.add(factor)
        indices = isam.update(graph, values).getNewFactorsIndices()[graph.size() - len(factors) :]
        made = [Made(*parts) for parts in zip(named, indices, relatives, strict=True)]
        return Smoother(self.manifold, self.model, isam, (*self.made, *made))

    def _linear(self, named: Sequence[Named], states: dict[int, Array]) -> tuple[list[Any], Array]:
        """Linear factors of (n,) semantic measurements, and (n, d) objects as the robot sees them there."""
        if not named:
            return [], np.zeros((0, self.manifold.dimension))
        x, o = (np.array([states[key] for key in keys]) for keys in _pairs(named))
        keys = [(item.robot_key, item.object_key) for item in named]
        classes = np.array([item.assigned_class for item in named])
        factors = self.model.semantic_factors([item.detection for item in named], keys, classes, x, o)
        return factors, self.manifold.between(x, o)

    def _settled(self, keys: Collection[int]) -> "Smoother | None":
        """Updated until no state is so far from where it is linearised that a further update would change it.

        Where states were linearised anew, so are the semantic factors of objects among ``keys``.
        """
        smoother = self
        for _ in range(MAX_UPDATES):
            deltas = smoother.isam.getDelta().vector().reshape(-1, self.manifold.dimension)
            if (np.abs(deltas) < self.manifold.relinearize_threshold).all():
                return smoother
            smoother = smoother._renewed(smoother._stale(keys))
        return None

    def _stale(self, objects: Collection[int]) -> list[int]:
        """Which of the linear factors of these objects are no longer where they were made."""
        rows = [row for row, made in enumerate(self.made) if made.named.object_key in objects]
        if not rows:
            return []
        now = self._relative([self.made[row].named for row in rows])
        before = np.array([self.made[row].relative for row in rows])
        changes = self.model.view_change(before, now)
        return [row for row, change in zip(rows, changes, strict=True) if change > MOVED]

    def _relative(self, named: Sequence[Named]) -> Array:
        """(n, d) objects as the robot sees them at the estimate."""
        robots, objects = _pairs(named)
        keys = sorted({*robots, *objects})
        states = self.states(keys)
        return self.manifold.between(states[np.searchsorted(keys, robots)], states[np.searchsorted(keys, objects)])

    def _renewed(self, rows: Sequence[int]) -> "Smoother":
        """After an update that relinearises, in which some linear factors are replaced by those at the estimate."""
        named = [self.made[row].named for row in rows]
        keys = sorted({key for item in named for key in (item.robot_key, item.object_key)})
        factors, relatives = self._linear(named, dict(zip(keys, self.states(keys), strict=True)))
        graph = gtsam.NonlinearFactorGraph()
        for factor in factors:
            graph.add(factor)
        result = self.isam.update(graph, gtsam.Values(), [self.made[row].index for row in rows], _joint_last(self.isam))
        made = list(self.made)
        for row, *parts in zip(rows, named, result.getNewFactorsIndices(), relatives, strict=True):
            made[row] = Made(*parts)
        return Smoother(self.manifold, self.model, self.isam, tuple(made))

    def _optimised(self, start: dict[int, Array]) -> "Smoother":
        """A new iSAM2 at the Levenberg-Marquardt optimum next to ``start``, its linear factors made there."""
        values = self.isam.calculateEstimate()
        for key, state in start.items():
            values.erase(key)
            self.manifold.insert(values, key, state)
        kept, named = self._nonlinear(), [made.named for made in self.made]
        keys = sorted({key for item in named for key in (item.robot_key, item.object_key)})
        for _ in range(MAX_ROUNDS):
            states = {key: self.manifold.state(values, key) for key in keys}
            graph = gtsam.NonlinearFactorGraph(kept)
            factors, relatives = self._linear(named, states)
            for factor in factors:
                graph.add(factor)
            values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
            if all(
                np.abs(self.manifold.local(states[key], self.manifold.state(values, key))).max() < SAME for key in keys
            ):
                break
        isam = _new_isam(self.manifold)
        indices = isam.update(graph, values).getNewFactorsIndices()[kept.size() :]
        made = [Made(*parts) for parts in zip(named, indices, relatives, strict=True)]
        return Smoother(self.manifold, self.model, isam, tuple(made))

    def _nonlinear(self) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph(self.isam.getFactorsUnsafe())
        kept = gtsam.NonlinearFactorGraph()
        for factor in (graph.at(i) for i in range(graph.size()) if graph.exists(i)):
            if not isinstance(factor, gtsam.LinearContainerFactor):
                kept.add(factor)
        return kept


def _pairs(named: Sequence[Named]) -> tuple[list[int], list[int]]:
    """Keys of the robots and of the objects."""
    return [item.robot_key for item in named], [item.object_key for item in named]


def _new_isam(manifold: Manifold) -> gtsam.ISAM2:
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    thresholds = gtsam.ISAM2ThresholdMap()
    for symbol in "xo":
        thresholds.insert((symbol, manifold.relinearize_threshold))
    parameters.setRelinearizeThreshold(thresholds)
    solver = gtsam.ISAM2GaussNewtonParams()
    solver.setWildfireThreshold(WILDFIRE_THRESHOLD)
    parameters.setOptimizationParams(solver)
    return gtsam.ISAM2(parameters)


def _joint_last(isam: gtsam.ISAM2) -> Any:
    """The order of elimination that keeps cheap what is read most, the joint covariance of newest robot and objects.

    An update without new factors would order them like all others. None where objects are too many for one clique.
    """
    keys = isam.getLinearizationPoint().keys()
    objects = [key for key in keys if key >> SYMBOL_BITS == ord("o")]
    if len(objects) >= MOST_JOINT:
        return None
    groups = gtsam.KeyGroupMap()
    for key in (*objects, max(key for key in keys if key >> SYMBOL_BITS == ord("x"))):
        groups.insert2(key, 1)
    return groups


def _first_line(fault: BaseException) -> str:
    return next((line for line in str(fault).splitlines() if line.strip()), type(fault).__name__)

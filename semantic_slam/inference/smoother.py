"""The iSAM2 of a component: forked, updated until it has converged, optimised as a whole where updates cannot.

Semantic factors are linear (a callback into Python costs sixty times as much): they are made at an estimate, and those
of an object that a keyframe observes are made anew where its view has changed. Its variables are poses of dimension d
and, with a learned latent space, descriptors of L components.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.odometry_bias import BIAS_LETTER, bias_prior
from semantic_slam.inference.semantic_factors import DESCRIPTOR, Made, Named, SemanticFactors, is_descriptor

Array = NDArray[np.float64]

MAX_UPDATES = 8
WILDFIRE_THRESHOLD = 1e-9
"""Back-substitution goes on until changes are below this, so that estimates are those of the whole system."""
SAME = 1e-3
"""Change of a state, metres or radians, below which linear factors need not be made again in an optimisation."""
MAX_ROUNDS = 6
MOST_JOINT = 24
"""States up to which their joint covariance costs less than those of single states."""
MAX_EXACT_ITERATIONS = 15
"""Of an optimisation with callbacks."""
SYMBOL_BITS = 56
"""Of a key, before its letter."""
STEPPED_SKIP, STEPPED_WILDFIRE = 10, 5e-3
"""Where updates are not iterated: keyframes from one relinearisation to the next, and change below which
back-substitution stops, metres or radians."""


class LostComponentError(SemanticSlamError):
    """A component's linear system is indeterminate; its hypothesis has to be given up."""


@dataclass(frozen=True)
class Smoother:
    """iSAM2 and the semantic measurements in it."""

    manifold: Manifold
    semantics: SemanticFactors
    isam: gtsam.ISAM2
    made: tuple[Made, ...] = ()
    num_descriptors: int = 0  # variables E(n)
    _known: dict[tuple[int, ...], Array] = field(default_factory=dict, compare=False, repr=False)

    @classmethod
    def of(
        cls, manifold: Manifold, semantics: SemanticFactors, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values
    ) -> "Smoother":
        """A new one."""
        isam = _new_isam(manifold, semantics)
        isam.update(graph, values)
        return cls(manifold, semantics, isam)

    def states(self, keys: Sequence[int]) -> Array:
        """(n, d) estimates of different keys."""
        if not len(keys):
            return np.zeros((0, self.manifold.dimension))
        ascending = self.manifold.states(self.isam.calculateEstimate(list(keys)))
        return ascending[np.argsort(np.argsort(keys))]

    def descriptors(self, keys: Sequence[int]) -> Array:
        """(n, L) estimates of descriptors."""
        return np.array([self.isam.calculateEstimateVector(key) for key in keys])

    def vector(self, key: int) -> Array:
        """(n,) estimate of a variable that is no pose."""
        return np.asarray(self.isam.calculateEstimateVector(key))

    def has(self, key: int) -> bool:
        """Whether there is such a variable."""
        return bool(self.isam.valueExists(key))

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """Marginal covariance in the order of ``keys``, d rows for a pose and L for a descriptor.

        In the tangent spaces at the estimate. Read once: a report and the prediction after it ask for the same.
        Raises LostComponentError.
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
        calm: Mapping[int, Array] | None = None,
    ) -> "Smoother":
        """A fork with the factors of ``graph`` and those of ``named``, made at ``start`` (key -> (d,) state).

        Where the estimate ``jumped`` to ``start``, or does not settle, the whole is optimised from there; with
        descriptors from ``calm``, what it lacks being where it was, if that explains everything better. Raises
        LostComponentError when the system is indeterminate.
        """
        try:
            origin = self.isam.calculateEstimate() if jumped else None
            if origin is not None:
                origin.insert(values)
            fork = self._updated(gtsam.ISAM2(self.isam), graph, values, named, start)
            certain = {item.descriptor_key for item in named if not item.exact}
            settled = None if jumped else fork._settled(start, certain)
            return fork._optimised(start, origin, calm or {}) if settled is None else settled
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

    def with_single_steps(self, num_biases: int) -> "Smoother":
        """The same system, to be updated once per keyframe: relinearised seldom, back-substituted to millimetres.

        With biases of odometry as a variable of its own, in which all is linear.
        """
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = STEPPED_SKIP
        thresholds = gtsam.ISAM2ThresholdMap()
        for symbol in "xo":
            thresholds.insert((symbol, self.manifold.far))
        thresholds.insert((BIAS_LETTER, np.full(num_biases, np.inf)))
        parameters.setRelinearizeThreshold(thresholds)
        parameters.enablePartialRelinearizationCheck = True
        solver = gtsam.ISAM2GaussNewtonParams()
        solver.setWildfireThreshold(STEPPED_WILDFIRE)
        parameters.setOptimizationParams(solver)
        isam = gtsam.ISAM2(parameters)
        isam.update(self.isam.getFactorsUnsafe(), self.isam.getLinearizationPoint())
        if num_biases:
            isam.update(*bias_prior(num_biases))
        return replace(self, isam=isam, _known={})

    def _updated(
        self,
        isam: gtsam.ISAM2,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        named: Sequence[Named],
        states: Mapping[int, Array],
    ) -> "Smoother":
        """``isam`` after one update, with linear factors made at ``states``."""
        factors, places = self.semantics.make(named, states)
        for factor in factors:
            graph.add(factor)
        new_descriptors = sum(is_descriptor(key) for key in values.keys())  # noqa: SIM118
        indices = isam.update(graph, values).getNewFactorsIndices()[graph.size() - len(factors) :]
        made = [Made(*parts) for parts in zip(named, indices, places, strict=True)]
        return Smoother(
            self.manifold, self.semantics, isam, (*self.made, *made), self.num_descriptors + new_descriptors
        )

    def _settled(self, keys: Collection[int], certain: Collection[int | None]) -> "Smoother | None":
        """Updated until no state is so far from where it is linearised that a further update would change it.

        Where states were linearised anew, so are the semantic factors of objects among ``keys``. Exact factors of
        ``certain`` descriptors become linear.
        """
        smoother, exact = self, self._exact(certain)
        for _ in range(MAX_UPDATES):
            if not exact and smoother._rests():
                return smoother
            smoother = smoother._renewed([*smoother._stale(keys), *exact])
            exact = []
        return None

    def _rests(self) -> bool:
        """Whether every variable is where it was linearised; descriptors come first, they have the lowest keys."""
        deltas = np.abs(self.isam.getDelta().vector())
        limit = self.semantics.descriptor_threshold
        split = self.num_descriptors * len(limit)
        poses = deltas[split:].reshape(-1, self.manifold.dimension) < self.manifold.relinearize_threshold
        return bool(poses.all() and (deltas[:split].reshape(-1, max(len(limit), 1)) < limit).all())

    def _exact(self, descriptor_keys: Collection[int | None]) -> list[int]:
        """Which semantic measurements of these descriptors have exact factors."""
        return [
            row
            for row, made in enumerate(self.made)
            if made.named.exact and made.named.descriptor_key in descriptor_keys
        ]

    def _stale(self, objects: Collection[int]) -> list[int]:
        """Which linear factors of these objects are no longer where they were made; of all where the map floats."""
        stale, floats = self._stale_of(objects)
        return self._stale_of({made.named.object_key for made in self.made})[0] if floats else stale

    def _stale_of(self, objects: Collection[int]) -> tuple[list[int], bool]:
        rows = [row for row, made in enumerate(self.made) if made.named.object_key in objects and not made.named.exact]
        if not rows:
            return [], False
        made = [self.made[row] for row in rows]
        moved, floats = self.semantics.moved(made, self._states_of([item.named for item in made]))
        return [row for row, stale in zip(rows, moved, strict=True) if stale], floats

    def _states_of(self, named: Sequence[Named]) -> dict[int, Array]:
        """Estimates of all variables of some semantic measurements."""
        keys = sorted({key for item in named for key in item.keys})
        descriptors = [key for key in keys if is_descriptor(key)]
        poses = keys[len(descriptors) :]
        states = [*self.descriptors(descriptors), *self.states(poses)]
        return dict(zip(keys, states, strict=True))

    def _renewed(self, rows: Sequence[int]) -> "Smoother":
        """After an update that relinearises, in which some factors are replaced by linear ones at the estimate."""
        named = [replace(self.made[row].named, exact=False) for row in rows]
        factors, places = self.semantics.make(named, self._states_of(named))
        graph = gtsam.NonlinearFactorGraph()
        for factor in factors:
            graph.add(factor)
        result = self.isam.update(graph, gtsam.Values(), [self.made[row].index for row in rows], _joint_last(self.isam))
        made = list(self.made)
        for row, own, index, place in zip(rows, named, result.getNewFactorsIndices(), places, strict=True):
            made[row] = Made(own, index, place)
        return replace(self, made=tuple(made), _known={})

    def _optimised(
        self, start: Mapping[int, Array], origin: gtsam.Values | None, calm: Mapping[int, Array]
    ) -> "Smoother":
        """A new iSAM2 at the Levenberg-Marquardt optimum next to ``start``, its linear factors made there.

        What ``start`` lacks begins at ``origin``, or at the estimate. Factors of descriptors are exact on the way: an
        object that turns, or a map that may float, is far from where linear ones hold.
        """
        learned = self.num_descriptors > 0
        estimate = self.isam.calculateEstimate() if origin is None or not learned else origin
        values = self._with(estimate, start)
        kept, named = self._kept(), [made.named for made in self.made]
        keys = sorted({key for item in named for key in item.keys})
        if learned:
            values = self._exactly(kept, [values, self._with(estimate, calm)] if calm else [values])
        for _ in range(MAX_ROUNDS):
            states = {key: self._state(values, key) for key in keys}
            graph = gtsam.NonlinearFactorGraph(kept)
            factors, places = self.semantics.make(named, states)
            for factor in factors:
                graph.add(factor)
            values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
            if all(self._change(key, states[key], self._state(values, key)) < SAME for key in keys):
                break
        isam = _new_isam(self.manifold, self.semantics)
        indices = isam.update(graph, values).getNewFactorsIndices()[kept.size() :]
        made = [Made(*parts) for parts in zip(named, indices, places, strict=True)]
        return replace(self, isam=isam, made=tuple(made), _known={})

    def _with(self, values: gtsam.Values, states: Mapping[int, Array]) -> gtsam.Values:
        """A copy with other states of some variables."""
        changed = gtsam.Values(values)
        for key, state in states.items():
            changed.erase(key)
            self._insert(changed, key, state)
        return changed

    def _exactly(self, kept: gtsam.NonlinearFactorGraph, starts: Sequence[gtsam.Values]) -> gtsam.Values:
        """The best of the optima next to some starts, with callbacks for all descriptors' factors, nearly reached."""
        named = [replace(made.named, exact=made.named.descriptor_key is not None) for made in self.made]
        states = {key: self._state(starts[0], key) for item in named for key in item.keys}
        graph = gtsam.NonlinearFactorGraph(kept)
        for factor in self.semantics.make(named, states)[0]:
            graph.add(factor)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(MAX_EXACT_ITERATIONS)
        ends = [gtsam.LevenbergMarquardtOptimizer(graph, start, parameters).optimize() for start in starts]
        return min(ends, key=graph.error)

    def _insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        if is_descriptor(key):
            values.insert(key, state)
        else:
            self.manifold.insert(values, key, state)

    def _state(self, values: gtsam.Values, key: int) -> Array:
        return np.asarray(values.atVector(key)) if is_descriptor(key) else self.manifold.state(values, key)

    def _change(self, key: int, before: Array, now: Array) -> float:
        """Largest change of a component, metres, radians or a descriptor's own unit."""
        return float(np.abs(now - before if is_descriptor(key) else self.manifold.local(before, now)).max())

    def _kept(self) -> gtsam.NonlinearFactorGraph:
        """All factors but the semantic ones."""
        graph = gtsam.NonlinearFactorGraph(self.isam.getFactorsUnsafe())
        semantic = {made.index for made in self.made}
        kept = gtsam.NonlinearFactorGraph()
        for factor in (graph.at(i) for i in range(graph.size()) if i not in semantic and graph.exists(i)):
            kept.add(factor)
        return kept


def _new_isam(manifold: Manifold, semantics: SemanticFactors) -> gtsam.ISAM2:
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    thresholds = gtsam.ISAM2ThresholdMap()
    for symbol in "xo":
        thresholds.insert((symbol, manifold.relinearize_threshold))
    if len(semantics.descriptor_threshold):
        thresholds.insert((DESCRIPTOR, semantics.descriptor_threshold))
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

"""The iSAM2 of one hypothesis's component: how it is forked, updated and read.

When a hypothesis branches, each child updates a fork of its parent's iSAM2; an only child consumes its parent's.

Semantic factors are linear in GTSAM's sense (a callback into Python costs sixty times as much): each is linearised at
an estimate, and those of an object that a keyframe observes are relinearised where its view has changed. The variables
are the states of robots and objects, with tangent spaces of r and l dimensions, and with a learned latent space
descriptors of L components.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.linear_factors import linearised
from semantic_slam.inference.models.odometry_bias import bias_prior
from semantic_slam.inference.smoothing.errors import first_line, lost_where_indeterminate
from semantic_slam.inference.smoothing.factor_table import (
    NO_FACTORS,
    NONE_ADDED,
    NONE_RELINEARISED,
    AddedFactors,
    FactorTable,
    RelinearisedFactors,
)
from semantic_slam.inference.smoothing.linear.charts import Charts
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearFactors, in_charts
from semantic_slam.inference.smoothing.linear.located import Located
from semantic_slam.inference.smoothing.linear.measured import Measured
from semantic_slam.inference.smoothing.linear.new_measurements import NewMeasurements
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints, SemanticFactor, SemanticFactorMaker
from semantic_slam.inference.smoothing.solver.elimination import groups, last_eliminated
from semantic_slam.inference.smoothing.solver.estimate import Estimate
from semantic_slam.inference.smoothing.solver.isam import (
    ALONG_RAYS,
    STEPPED_SKIP,
    OwnedIsam,
    new_isam,
    single_step_isam,
)
from semantic_slam.inference.smoothing.solver.marginal_reader import MarginalReader
from semantic_slam.inference.smoothing.solver.relinearisation import relinearised
from semantic_slam.inference.states.keys import is_descriptor
from semantic_slam.inference.states.spaces import Spaces

FEW_VARIABLES = 200
"""Number of variables below which reading the whole estimate once costs less than reading parts of it."""
CONVERGED = 1.5
"""How far, in relinearisation thresholds, a state or a factor may be from its linearisation point at the end of a
keyframe. The next update relinearises whatever is over one threshold; a further update now, for something hardly over
it, would cost as much as that."""


@dataclass(frozen=True, kw_only=True)
class Smoother:
    """iSAM2 with the semantic measurements in it.

    Updating a smoother consumes it: it hands its iSAM2 on, and from then on raises ConsumedSmootherError on every use.
    Whoever needs the smoother again updates a ``fork()`` instead.
    """

    spaces: Spaces
    semantics: SemanticFactorMaker
    owned: OwnedIsam
    num_variables: int
    factor_table: FactorTable = NO_FACTORS
    num_descriptors: int = 0  # variables E(n)
    in_charts: LinearFactors | None = None  # measurements, where iSAM2 holds them linear in fixed charts
    steps: int = 0  # updates since ``with_single_steps``
    single_steps: bool = False  # one update per keyframe, not iterated until convergence
    along_rays: bool = False  # some object was seen by a ray alone: states are relinearised earlier
    is_summarised: bool = False  # the past is marginalised into one factor over all objects
    last: tuple[int, ...] = ()  # keys eliminated last, whose joint covariance is read most; empty if too many
    _here: list[Located] = field(default_factory=list, compare=False, repr=False)  # ``_located``, cached

    @classmethod
    def of(
        cls, spaces: Spaces, semantics: SemanticFactorMaker, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values
    ) -> "Smoother":
        """A smoother of the factors ``graph`` at ``values``, without semantic measurements. Raises InputError."""
        isam = new_isam(spaces, semantics.descriptor_threshold)
        try:
            isam.update(graph, values)
        except RuntimeError as fault:
            raise InputError(
                f"initial pose and map make no system that can be solved ({first_line(fault)});"
                " give them covariances of ordinary size"
            ) from None
        return cls(
            spaces=spaces,
            semantics=semantics,
            owned=OwnedIsam(isam),
            num_variables=values.size(),
            last=last_eliminated(values.keys()),
        )

    @property
    def isam(self) -> gtsam.ISAM2:
        """GTSAM's iSAM2 of this smoother. Raises ConsumedSmootherError."""
        return self.owned.isam

    def fork(self) -> "Smoother":
        """An independent copy: updates of either leave the other as it is."""
        return replace(self, owned=self.owned.fork())

    def states(self, keys: Sequence[int]) -> Array:
        """(n, s) estimates of distinct keys in the order given, padded to the wider of robot and object states."""
        if not len(keys):
            return np.zeros((0, self.spaces.storage.width))
        if self.in_charts is not None:
            _ = self.isam  # raises where it was consumed
            return self._located.states(keys, self.spaces.storage)
        if self.num_variables < FEW_VARIABLES:
            return self.estimate.states(keys)
        ascending = self.spaces.states(self.isam.calculateEstimate(list(keys)))
        return ascending[_ranks(tuple(keys))]

    @property
    def estimate(self) -> Estimate:
        """Estimate of all variables, read from iSAM2 once and cached."""
        _ = self.isam  # raises where it was consumed
        return self._estimate

    @cached_property
    def _estimate(self) -> Estimate:
        return Estimate.of(self.spaces, self.isam.calculateEstimate(), self.num_descriptors)

    def descriptors(self, keys: Sequence[int]) -> Array:
        """(n, L) estimates of descriptors by their keys."""
        return np.array([self.isam.calculateEstimateVector(key) for key in keys])

    def vector(self, key: int) -> Array:
        """(n,) estimate of a vector-valued variable, which is no pose."""
        return np.asarray(self.isam.calculateEstimateVector(key))

    def has(self, key: int) -> bool:
        """Whether the graph has this variable."""
        return bool(self.isam.valueExists(key))

    @cached_property
    def _marginals(self) -> MarginalReader:
        return MarginalReader(
            spaces=self.spaces,
            owned=self.owned,
            descriptor_size=len(self.semantics.descriptor_threshold),
            last=self.last,
            is_summarised=self.is_summarised,
            located=None if self.in_charts is None else partial(_read_once, self.owned, self.in_charts, self._here),
        )

    def joint_covariance(self, keys: Sequence[int]) -> Array:
        """Marginal covariance of the ``keys``, see :meth:`MarginalReader.joint`. Raises LostComponentError."""
        return self._marginals.joint(keys)

    def covariances(self, keys: Sequence[int]) -> Array:
        """(n, l, l) marginal covariances of objects, in the tangent spaces there. Raises LostComponentError."""
        return self._marginals.of_objects(keys)

    def joint_blocks(self, keys: Sequence[int]) -> Array:
        """(n, w, w) marginal covariances, one block each of a robot and objects. Raises LostComponentError."""
        return self._marginals.blocks(keys)

    def stepped(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        measurements: Sequence[SemanticFactor],
        start: dict[int, Array],
        *,
        again: bool,
        new: NewMeasurements | None = None,
    ) -> "Smoother":
        """The smoother after one update, or two where ``again``, not iterated to convergence. It consumes this one.

        ``new`` holds the keyframe's odometry and detections, linearised, where the smoother keeps its measurements
        linear in charts. Semantic factors keep the linearisation point that they are made at. Raises LostComponentError
        when the system is indeterminate.
        """
        assert (new is None) == (self.in_charts is None)
        with lost_where_indeterminate("an update"):
            points = LinearisationPoints.of(measurements, start)
            added = AddedFactors(measurements, self.semantics.make([measurements], [points])[0], points)
            if new is not None:
                return self._stepped_in_charts(graph, added, new, again=again)
            child = self.updated(graph, values, added)
            if again:
                child.isam.update(force_relinearize=True)
        return child

    def with_charts(self, values: gtsam.Values, measured: Sequence[Measured]) -> NewMeasurements:
        """New measurements, not linearised yet, with charts of new variables, which are estimated at ``values``."""
        assert self.in_charts is not None
        return NewMeasurements.of(self.in_charts, self._located, values, measured)

    def _stepped_in_charts(
        self, graph: gtsam.NonlinearFactorGraph, added: AddedFactors, new: NewMeasurements, *, again: bool
    ) -> "Smoother":
        """One update with measurements linearised at the current estimate; all are relinearised where that is due.

        That is every ``STEPPED_SKIP`` updates, and at once where ``again``.
        """
        together = linearised(graph, self._vectors(new.values, graph.keyVector()))
        others = together.size()
        for own in new.made:
            together.push_back(own.factors())
        semantic = [in_charts(factor, new.factors.charts, new.at) for factor in added.factors]
        child = self.updated(together, new.values, replace(added, factors=semantic))
        factors = new.factors.with_new(new.made, others, len(semantic))
        child = replace(child, in_charts=factors, steps=self.steps + 1)
        if not again and child.steps % STEPPED_SKIP:
            return child
        isam, factors = relinearised(child.owned.hand_on().isam, factors)
        return replace(child, owned=OwnedIsam(isam), in_charts=factors, _here=[])

    @property
    def _located(self) -> Located:
        """Estimates of robots and objects in their charts, read from iSAM2 once and cached."""
        assert self.in_charts is not None
        return _read_once(self.owned, self.in_charts, self._here)

    def _vectors(self, values: gtsam.Values, keys: Sequence[int]) -> gtsam.Values:
        """New variables at their ``values``, and the current estimates of the other ``keys``, which are vectors."""
        point = self.isam.calculateEstimate([key for key in keys if not values.exists(key)])
        point.insert(values)
        return point

    def with_single_steps(self, num_biases: int, *, errors_repeat: bool, factorization: str = "CHOLESKY") -> "Smoother":
        """The smoother set up for one update per keyframe: rare relinearisation, back-substitution to millimetres.

        Back-substitution goes further where ``errors_repeat``, that is, where detection errors are correlated over
        time. Biases of odometry, ``num_biases`` of them, are added as a variable of their own; every factor is linear
        in it.
        """
        isam = single_step_isam(self.spaces, errors_repeat=errors_repeat, factorization=factorization)
        graph, values = gtsam.NonlinearFactorGraph(self.isam.getFactorsUnsafe()), self.isam.getLinearizationPoint()
        if num_biases:
            prior, zero = bias_prior(num_biases)
            graph.push_back(prior)
            values.insert(zero)
        isam.update(linearised(graph, values) if errors_repeat else graph, values)
        factors = None
        if errors_repeat:
            charts = Charts.of(self.spaces, values)
            factors = LinearFactors(charts=charts, model=self.semantics.model, num_slots=graph.size())
        return replace(
            self,
            owned=OwnedIsam(isam),
            num_variables=values.size(),
            in_charts=factors,
            single_steps=True,
            _here=[],
        )

    def updated(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        added: AddedFactors,
        renewal: RelinearisedFactors = NONE_RELINEARISED,
    ) -> "Smoother":
        """The smoother after one iSAM2 update with ``graph`` and new or renewed semantic factors; consumes this one."""
        owned = self.owned.hand_on()
        together = gtsam.NonlinearFactorGraph(graph)
        for factor in (*added.factors, *renewal.factors):
            together.add(factor)
        removed = [self.factor_table.indices[row] for row in renewal.rows]
        last = (
            last_eliminated([*self.last, *values.keys()], added.measurements)
            if self.last and values.size()
            else self.last
        )
        indices = owned.isam.update(together, values, removed, groups(last)).getNewFactorsIndices()[graph.size() :]
        split = len(added.factors)
        table = self.factor_table
        made = table.replaced(renewal.rows, table.linear(renewal.rows), indices[split:], renewal.points)
        made = made.added(added.measurements, indices[:split], added.points)
        size = self.num_variables + values.size()
        descriptors = self.num_descriptors + sum(is_descriptor(key) for key in values.keys())  # noqa: SIM118
        return Smoother(
            spaces=self.spaces,
            semantics=self.semantics,
            owned=owned,
            num_variables=size,
            factor_table=made,
            num_descriptors=descriptors,
            single_steps=self.single_steps,
            along_rays=self.along_rays,
            is_summarised=self.is_summarised,
            last=last,
        )

    def renewed(self, renewal: RelinearisedFactors) -> "Smoother":
        """The smoother after an update that relinearises and replaces semantic factors; it consumes this one."""
        return self.updated(gtsam.NonlinearFactorGraph(), gtsam.Values(), NONE_ADDED, renewal)

    def restarted(
        self, kept: gtsam.NonlinearFactorGraph, values: gtsam.Values, factors: Sequence[Any], made: FactorTable
    ) -> "Smoother":
        """A new iSAM2 of the factors ``kept`` and the semantic ones, linearised at ``values``.

        It factorises by QR where the system is too poorly conditioned for Cholesky: where the robot stands on an
        object, a bearing is thousands of times as informative across the line of sight as everything else is along it.
        """
        graph = gtsam.NonlinearFactorGraph(kept)
        for factor in factors:
            graph.add(factor)
        last = last_eliminated(values.keys())
        isam = self._empty_isam()
        try:
            result = isam.update(graph, values, [], groups(last))
        except RuntimeError:
            isam = self._empty_isam("QR")
            result = isam.update(graph, values, [], groups(last))
        if not np.isfinite(isam.getDelta().vector()).all():
            raise RuntimeError("the system is not finite")
        indices = result.getNewFactorsIndices()[kept.size() :]
        descriptors = sum(is_descriptor(key) for key in values.keys())  # noqa: SIM118
        made = replace(made, indices=tuple(indices))
        return Smoother(
            spaces=self.spaces,
            semantics=self.semantics,
            owned=OwnedIsam(isam),
            num_variables=values.size(),
            factor_table=made,
            num_descriptors=descriptors,
            single_steps=self.single_steps,
            along_rays=self.along_rays,
            is_summarised=self.is_summarised,
            last=last,
        )

    def _empty_isam(self, factorization: str = "CHOLESKY") -> gtsam.ISAM2:
        """An empty iSAM2 with the parameters of this smoother."""
        if self.single_steps:
            return single_step_isam(self.spaces, errors_repeat=False, factorization=factorization)
        return new_isam(self.spaces, self.semantics.descriptor_threshold, factorization, fineness=self._fineness)

    @property
    def _fineness(self) -> float:
        """Share of the usual relinearisation thresholds."""
        return ALONG_RAYS if self.along_rays else 1.0

    def converged(self) -> bool:
        """Whether every variable is within about one threshold of its linearisation point.

        Descriptors, which come first in key order, count only while they have exact factors: linear factors in a vector
        space say the same at every linearisation point.
        """
        deltas = np.abs(self.isam.getDelta().vector()) / CONVERGED
        limit = self.semantics.descriptor_threshold
        split = self.num_descriptors * len(limit)
        if not self.spaces.are_within(deltas[split:] / self._fineness, self.num_variables - self.num_descriptors):
            return False
        return not self.factor_table.exact.any() or bool((deltas[:split].reshape(-1, len(limit)) < limit).all())

    def points(self, rows: Sequence[int] | Index) -> LinearisationPoints:
        """Current estimates of the variables of the semantic measurements ``rows``: where to relinearise them."""
        return self.estimate.points(self.factor_table.keys[rows])

    def kept(self) -> gtsam.NonlinearFactorGraph:
        """All factors of the graph but the semantic ones."""
        return self.factor_table.without(self.isam.getFactorsUnsafe())


def _read_once(owned: OwnedIsam, factors: LinearFactors, here: list[Located]) -> Located:
    """Estimates of an iSAM2's variables in charts; computed the first time and cached in the list ``here``."""
    if not here:
        here.append(factors.charts.located(owned.isam.getDelta().vector()))
    return here[0]


@lru_cache(maxsize=1024)
def _ranks(keys: tuple[int, ...]) -> NDArray[np.int_]:
    """Rank of each key among all of them."""
    return np.argsort(np.argsort(keys))

"""The iSAM2 of a component: forked when its hypothesis branches, else consumed by the only child; updated, read.

Semantic factors are linear (a callback into Python costs sixty times as much): they are made at an estimate, and those
of an object that a keyframe observes are made anew where its view has changed. Its variables are states of robots and
objects, of tangent spaces of r and l dimensions, and with a learned latent space descriptors of L components.
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
from semantic_slam.inference.smoothing.elimination import groups, last_eliminated
from semantic_slam.inference.smoothing.errors import first_line, lost_where_indeterminate
from semantic_slam.inference.smoothing.estimate import Estimate
from semantic_slam.inference.smoothing.factor_table import (
    NO_FACTORS,
    NONE_ADDED,
    NONE_RELINEARISED,
    AddedFactors,
    FactorTable,
    RelinearisedFactors,
)
from semantic_slam.inference.smoothing.isam import STEPPED_SKIP, OwnedIsam, new_isam, single_step_isam
from semantic_slam.inference.smoothing.linear.charts import Charts
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearFactors, in_charts, new_measurements
from semantic_slam.inference.smoothing.linear.located import Located
from semantic_slam.inference.smoothing.linear.measured import Measured
from semantic_slam.inference.smoothing.marginal_reader import MarginalReader
from semantic_slam.inference.smoothing.relinearisation import relinearised
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints, SemanticFactor, SemanticFactorMaker
from semantic_slam.inference.states.keys import is_descriptor
from semantic_slam.inference.states.spaces import Spaces

FEW_VARIABLES = 200
"""Up to which reading the whole estimate once costs less than reading parts of it."""
CONVERGED = 1.5
"""Thresholds that a state may be off where it is linearised at the end of a keyframe, or a factor where it was made:
the next update does anew what is over one, while an update now, for what is hardly over it, costs as much as that."""


@dataclass(frozen=True, kw_only=True)
class Smoother:
    """iSAM2 and the semantic measurements in it.

    Updates consume a smoother: it hands its iSAM2 on and raises ConsumedSmootherError whatever it is asked. Whoever
    needs it again updates a ``fork()``.
    """

    spaces: Spaces
    semantics: SemanticFactorMaker
    owned: OwnedIsam
    num_variables: int
    factor_table: FactorTable = NO_FACTORS
    num_descriptors: int = 0  # variables E(n)
    in_charts: LinearFactors | None = None  # its measurements where iSAM2 holds them linear
    steps: int = 0  # updates since it began to be updated once per keyframe
    single_steps: bool = False  # updated once per keyframe
    is_summarised: bool = False  # its past is one factor over all objects
    last: tuple[int, ...] = ()  # eliminated last, for their joint covariance is read most; none where they are many
    _here: list[Located] = field(default_factory=list, compare=False, repr=False)  # which a fork goes on with

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
        """A copy that grows apart from this one."""
        return replace(self, owned=self.owned.fork())

    def states(self, keys: Sequence[int]) -> Array:
        """(n, s) estimates of different keys, as wide as the wider of robots and objects."""
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
        """Estimate of all variables, read from iSAM2 once."""
        _ = self.isam  # raises where it was consumed
        return self._estimate

    @cached_property
    def _estimate(self) -> Estimate:
        return Estimate.of(self.spaces, self.isam.calculateEstimate(), self.num_descriptors)

    def descriptors(self, keys: Sequence[int]) -> Array:
        """(n, L) estimates of descriptors by their keys."""
        return np.array([self.isam.calculateEstimateVector(key) for key in keys])

    def vector(self, key: int) -> Array:
        """(n,) estimate of a variable that is no pose."""
        return np.asarray(self.isam.calculateEstimateVector(key))

    def has(self, key: int) -> bool:
        """Whether there is such a variable."""
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
        """(n, w, w) marginal covariances of a robot and objects. Raises LostComponentError."""
        return self._marginals.blocks(keys)

    def stepped(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        measurements: Sequence[SemanticFactor],
        start: dict[int, Array],
        *,
        again: bool,
        measured: Sequence[Measured] = (),
    ) -> "Smoother":
        """The smoother after one update, two where ``again``, without waiting until it converges; it consumes this one.

        ``measured`` is what the keyframe measures, where the smoother holds its measurements linear.
        Semantic factors stay as they are made. Raises LostComponentError when the system is indeterminate.
        """
        with lost_where_indeterminate("an update"):
            points = LinearisationPoints.of(measurements, start)
            added = AddedFactors(measurements, self.semantics.make([measurements], [points])[0], points)
            if self.in_charts is not None:
                return self._stepped_in_charts(self.in_charts, graph, values, added, measured, again=again)
            child = self.updated(graph, values, added)
            if again:
                child.isam.update(force_relinearize=True)
        return child

    def _stepped_in_charts(
        self,
        before: LinearFactors,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        added: AddedFactors,
        measured: Sequence[Measured],
        *,
        again: bool,
    ) -> "Smoother":
        """One update with factors that are made linear here, at the estimates; anew where these bend them."""
        charts, at, values = before.charts.extended(values, self._located)
        factors, now = replace(before, charts=charts), new_measurements(measured, values, charts.vectors)
        made = factors.made(now, at)
        together = linearised(graph, self._vectors(values, graph.keyVector()))
        others = together.size()
        for own in made:
            together.push_back(own.factors())
        semantic = [in_charts(factor, charts, at) for factor in added.factors]
        child = self.updated(together, values, replace(added, factors=semantic))
        factors = factors.with_new(made, others, len(semantic))
        child = replace(child, in_charts=factors, steps=self.steps + 1)
        if not again and child.steps % STEPPED_SKIP:
            return child
        isam, factors = relinearised(child.owned.hand_on().isam, factors)
        return replace(child, owned=OwnedIsam(isam), in_charts=factors, _here=[])

    @property
    def _located(self) -> Located:
        """Where robots and objects are in charts, read from iSAM2 once."""
        assert self.in_charts is not None
        return _read_once(self.owned, self.in_charts, self._here)

    def _vectors(self, values: gtsam.Values, keys: Sequence[int]) -> gtsam.Values:
        """New variables at their ``values``, and estimates of the others among ``keys``, which are vectors."""
        point = self.isam.calculateEstimate([key for key in keys if not values.exists(key)])
        point.insert(values)
        return point

    def with_single_steps(self, num_biases: int, *, errors_repeat: bool) -> "Smoother":
        """The smoother to be updated once per keyframe: relinearised seldom, back-substituted to millimetres.

        Nearer where ``errors_repeat``. With biases of odometry as a variable of its own, in which all is linear.
        """
        isam = single_step_isam(self.spaces, errors_repeat=errors_repeat)
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
        """The smoother after one update with ``graph`` and semantic factors, new and renewed; it consumes this one."""
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

        It factorises by QR where Cholesky finds the system too poorly conditioned: where the robot stands on an object,
        a bearing tells thousands of times as much across it as the rest tells along.
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
            is_summarised=self.is_summarised,
            last=last,
        )

    def _empty_isam(self, factorization: str = "CHOLESKY") -> gtsam.ISAM2:
        """One to begin anew with."""
        if self.single_steps:
            return single_step_isam(self.spaces, errors_repeat=False, factorization=factorization)
        return new_isam(self.spaces, self.semantics.descriptor_threshold, factorization)

    def converged(self) -> bool:
        """Whether all variables are about where they were linearised.

        Descriptors, which come first by their keys, count while they have exact factors: linear ones in a vector space
        say the same wherever they are linearised.
        """
        deltas = np.abs(self.isam.getDelta().vector()) / CONVERGED
        limit = self.semantics.descriptor_threshold
        split = self.num_descriptors * len(limit)
        if not self.spaces.are_within(deltas[split:], self.num_variables - self.num_descriptors):
            return False
        return not self.factor_table.exact.any() or bool((deltas[:split].reshape(-1, len(limit)) < limit).all())

    def points(self, rows: Sequence[int] | Index) -> LinearisationPoints:
        """Estimates of the variables of some semantic measurements."""
        return self.estimate.points(self.factor_table.keys[rows])

    def kept(self) -> gtsam.NonlinearFactorGraph:
        """All factors but the semantic ones."""
        return self.factor_table.without(self.isam.getFactorsUnsafe())


def _read_once(owned: OwnedIsam, factors: LinearFactors, here: list[Located]) -> Located:
    """Where the variables of an iSAM2 are; read the first time, and kept ``here``, which is empty then."""
    if not here:
        here.append(factors.charts.located(owned.isam.getDelta().vector()))
    return here[0]


@lru_cache(maxsize=1024)
def _ranks(keys: tuple[int, ...]) -> NDArray[np.int_]:
    """Rank of each key among them all."""
    return np.argsort(np.argsort(keys))

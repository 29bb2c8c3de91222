"""Full Levenberg-Marquardt optimisation of a smoother's graph, where iSAM2 updates would not converge."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.factor_table import NO_FACTORS
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints, SemanticFactor, SemanticFactorMaker
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.keys import is_descriptor
from semantic_slam.inference.states.spaces import Spaces

SAME = 1e-3
"""Change of a state [m or rad] below which linear factors need not be relinearised."""
MAX_ROUNDS = 6
FEW_VARIABLES = 40
"""Number of variables up to which optimising all costs less than finding out which are connected."""
MAX_EXACT_ITERATIONS = 15
"""Most iterations of an optimisation whose factors call back into Python."""


def reoptimised(
    smoother: Smoother,
    kept: gtsam.NonlinearFactorGraph,
    measurements: Sequence[SemanticFactor],
    starts: Sequence[gtsam.Values],
) -> Smoother:
    """A new iSAM2 of ``kept`` and semantic measurements at the optimum next to a start, linearised there.

    Under classes the first start is used. With descriptors all are, with exact factors, and the best optimum is taken:
    an object that turns, or a map that is not anchored, is far from where linear factors hold.
    """
    semantics = smoother.semantics
    if semantics.latent is not None and measurements:
        values = _exactly(semantics, kept, measurements, starts)
    else:
        values = _by_rounds(semantics, kept, measurements, starts[0])
    keys = sorted({key for item in measurements for key in item.keys})
    points = LinearisationPoints.of(measurements, _states(semantics.spaces, values, keys))
    factors = semantics.make([measurements], [points])[0]
    return smoother.restarted(kept, values, factors, NO_FACTORS.added(measurements, (), points))


def _by_rounds(
    semantics: SemanticFactorMaker,
    kept: gtsam.NonlinearFactorGraph,
    measurements: Sequence[SemanticFactor],
    values: gtsam.Values,
) -> gtsam.Values:
    """Optimised with linear semantic factors, which are relinearised until nothing changes."""
    keys = sorted({key for item in measurements for key in item.keys})
    states = _states(semantics.spaces, values, keys)
    kept, tied = _tied(kept, values)
    for _ in range(MAX_ROUNDS):
        factors = semantics.make([measurements], [LinearisationPoints.of(measurements, states)])[0]
        tied = gtsam.LevenbergMarquardtOptimizer(_joined(kept, factors), tied).optimize()
        before, states = states, _states(semantics.spaces, tied, keys)
        if all(np.abs(semantics.spaces.of(key).local(before[key], states[key])).max() < SAME for key in keys):
            break
    whole = gtsam.Values(values)
    whole.update(tied)
    return whole


def _tied(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Factors and values of the variables that some factor connects to another variable.

    The others, objects not seen yet, stay at their priors; in a large map they are the majority.
    """
    if values.size() <= FEW_VARIABLES:
        return graph, values
    factors = [graph.at(i) for i in range(graph.size())]
    keys = [factor.keys() for factor in factors]
    known = set[int]().union(*(factor_keys for factor_keys in keys if len(factor_keys) > 1))
    part, states = gtsam.NonlinearFactorGraph(), gtsam.Values(values)
    for factor, factor_keys in zip(factors, keys, strict=True):
        if known.issuperset(factor_keys):
            part.add(factor)
    for key in set(values.keys()) - known:
        states.erase(key)
    return part, states


def changed(spaces: Spaces, values: gtsam.Values, states: Mapping[int, Array]) -> gtsam.Values:
    """A copy of ``values`` with new states of some variables."""
    copy = gtsam.Values(values)
    for key, state in states.items():
        copy.erase(key)
        if is_descriptor(key):
            copy.insert(key, state)
        else:
            spaces.of(key).insert(copy, key, state)
    return copy


def _exactly(
    semantics: SemanticFactorMaker,
    kept: gtsam.NonlinearFactorGraph,
    measurements: Sequence[SemanticFactor],
    starts: Sequence[gtsam.Values],
) -> gtsam.Values:
    """The best of the optima next to the starts, with exact (callback) semantic factors, nearly converged."""
    exact = [replace(item, exact=True) for item in measurements]
    states = _states(semantics.spaces, starts[0], sorted({key for item in measurements for key in item.keys}))
    graph = _joined(kept, semantics.make([exact], [LinearisationPoints.of(exact, states)])[0])
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(MAX_EXACT_ITERATIONS)
    ends = [gtsam.LevenbergMarquardtOptimizer(graph, start, parameters).optimize() for start in starts]
    return min(ends, key=graph.error)


def _joined(kept: gtsam.NonlinearFactorGraph, factors: Sequence[gtsam.NonlinearFactor]) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph(kept)
    for factor in factors:
        graph.add(factor)
    return graph


def _states(spaces: Spaces, values: gtsam.Values, keys: Sequence[int]) -> dict[int, Array]:
    return {
        key: np.asarray(values.atVector(key)) if is_descriptor(key) else spaces.of(key).state(values, key)
        for key in keys
    }

"""A smoother's whole graph optimised by Levenberg-Marquardt, where updates of iSAM2 would not get there."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.linear_factors import is_descriptor
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.semantic_factors import Named, Places, SemanticFactors
from semantic_slam.inference.smoother import Made, Smoother

Array = NDArray[np.float64]

SAME = 1e-3
"""Change of a state, metres, radians or a descriptor's own unit, below which linear factors need not be made again."""
MAX_ROUNDS = 6
MAX_EXACT_ITERATIONS = 15
"""Of an optimisation with callbacks."""


def reoptimised(
    smoother: Smoother,
    kept: gtsam.NonlinearFactorGraph,
    named: Sequence[Named],
    starts: Sequence[gtsam.Values],
) -> Smoother:
    """A new iSAM2 of ``kept`` and of semantic measurements at the optimum next to a start, linear factors made there.

    Under classes the first start is taken. With descriptors the one that ends best, factors exact on the way: an object
    that turns, or a map that may float, is far from where linear ones hold.
    """
    semantics, manifold = smoother.semantics, smoother.manifold
    values = starts[0]
    if semantics.latent is not None and named:
        values = _exactly(semantics, kept, named, starts)
    keys = sorted({key for item in named for key in item.keys})
    states = _states(manifold, values, keys)
    for _ in range(MAX_ROUNDS):
        places = Places.of(named, states)
        factors = semantics.make([named], [places])[0]
        values = gtsam.LevenbergMarquardtOptimizer(_joined(kept, factors), values).optimize()
        before, states = states, _states(manifold, values, keys)
        if all(_change(manifold, key, before[key], states[key]) < SAME for key in keys):
            break
    else:  # not there yet: the factors are those of where it is
        places = Places.of(named, states)
        factors = semantics.make([named], [places])[0]
    return smoother.restarted(kept, values, factors, Made(tuple(named), (), places))


def changed(manifold: Manifold, values: gtsam.Values, states: Mapping[int, Array]) -> gtsam.Values:
    """A copy with other states of some variables."""
    copy = gtsam.Values(values)
    for key, state in states.items():
        copy.erase(key)
        if is_descriptor(key):
            copy.insert(key, state)
        else:
            manifold.insert(copy, key, state)
    return copy


def _exactly(
    semantics: SemanticFactors,
    kept: gtsam.NonlinearFactorGraph,
    named: Sequence[Named],
    starts: Sequence[gtsam.Values],
) -> gtsam.Values:
    """The best of the optima next to some starts, with callbacks for all semantic factors, nearly reached."""
    exact = [replace(item, exact=True) for item in named]
    states = _states(semantics.manifold, starts[0], sorted({key for item in named for key in item.keys}))
    graph = _joined(kept, semantics.make([exact], [Places.of(exact, states)])[0])
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(MAX_EXACT_ITERATIONS)
    ends = [gtsam.LevenbergMarquardtOptimizer(graph, start, parameters).optimize() for start in starts]
    return min(ends, key=graph.error)


def _joined(kept: gtsam.NonlinearFactorGraph, factors: Sequence[gtsam.NonlinearFactor]) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph(kept)
    for factor in factors:
        graph.add(factor)
    return graph


def _states(manifold: Manifold, values: gtsam.Values, keys: Sequence[int]) -> dict[int, Array]:
    return {
        key: np.asarray(values.atVector(key)) if is_descriptor(key) else manifold.state(values, key) for key in keys
    }


def _change(manifold: Manifold, key: int, before: Array, now: Array) -> float:
    """Largest change of a component, metres, radians or a descriptor's own unit."""
    return float(np.abs(now - before if is_descriptor(key) else manifold.local(before, now)).max())

"""Gating of detection-object pairs, and the best joint assignments (JPDA-style) of one hypothesis.

Costs are those of single pairs, linearised at the prediction. In these terms the sum over all joint assignments is
known exactly, and so is the mass of those that are not enumerated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy
from semantic_slam.geometry.levenberg_marquardt import MAX_ITERATIONS
from semantic_slam.inference.association.murty import k_best
from semantic_slam.inference.association.pair_search import LARGEST_BEND, StatePairs, bend
from semantic_slam.inference.association.sums import log_sum_of_all
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.correlated_errors import PredictedErrors
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.models.observation import Innovation, Linearisation, ObservationModel
from semantic_slam.inference.states.spaces import Spaces

SLACK = 1e-6
"""Tolerance of a gate in nats, against differences in rounding."""


@dataclass(frozen=True)
class PairDensities:
    """Densities of all pairs of D detections and M objects, with their linearisation."""

    log_density: Array  # (D, M) of the detection if it is of this object
    distance: Array  # (D, M) Mahalanobis
    part: Linearisation  # (D, M, ...)
    offsets: Array | None = None  # (D, M, m) change of linear residuals, prediction to linearisation point; None: 0
    elsewhere: Flags | None = None  # (D, M) pairs that were linearised elsewhere than at the prediction
    at_prediction: Linearisation | None = None  # (D, M, ...) at the prediction; None: ``part`` is there
    tail: HeavyTail | None = None  # outlier model of the detections' errors; None: there are no outliers
    outlier_distance: Array | None = None  # (D, M) Mahalanobis, under an outlier's wider covariance
    log_words: Array | None = None  # (D, M + 1) log likelihoods of labels by object, last: no object; None: unused


def pair_densities(
    spaces: Spaces,
    model: ObservationModel,
    detections: Sequence[Any],
    predicted: PredictedBelief,
    errors: PredictedErrors | None = None,
    tail: HeavyTail | None = None,
) -> PairDensities:
    """Densities of all pairs from the ``predicted`` robot and M objects of one parent.

    ``errors``: prediction of the detections' correlated errors, if these are modelled; residuals are then whitened by
    the uncorrelated rest of the noise.
    """
    mean = predicted.mean[0]
    count = len(mean) - 1
    shape = len(detections), count
    if not count or not detections:
        nothing = np.zeros(shape)
        return PairDensities(nothing, nothing, _no_pairs(shape), tail=tail, outlier_distance=nothing)
    joint = predicted.pair_covariances[0]
    rows, storage = len(detections) * count, spaces.storage
    collected = model.collect(detections)
    if len(detections) > 1:  # a single row is broadcast
        collected = collected.take(np.repeat(np.arange(len(detections)), count))
    robots = broadcast_copy(mean[0, : storage.robot], (rows, storage.robot))
    states = np.tile(mean[1:, : storage.landmark], (len(detections), 1))
    part = model.geometry(collected, robots, states)
    if errors is not None:
        return _at_prediction(*_with_errors(spaces, errors, part, joint, shape), shape, tail)
    prior = np.tile(joint, (len(detections), 1, 1))
    jacobian = np.concatenate([part.jacobian_robot, part.jacobian_object], axis=-1)
    if tail is None:  # candidates are weighed at their modes
        turns = np.repeat(np.sqrt([detection.turn_variance for detection in detections]), count)
        bent = np.flatnonzero(bend(turns, jacobian, prior) > LARGEST_BEND)
        if len(bent):
            pairs = StatePairs(
                spaces=spaces,
                model=model,
                detections=model.collect(detections).take(bent // count),
                robots=robots[bent],
                objects=states[bent],
                root=np.linalg.cholesky(prior[bent]),
            )
            return _at_modes(pairs, bent, part, prior, shape)
    return _at_prediction(part, jacobian, prior, shape, tail)


def _with_errors(
    spaces: Spaces, errors: PredictedErrors, part: Linearisation, joint: Array, shape: tuple[int, int]
) -> tuple[Linearisation, Array, Array]:
    """Pairs (D M, ...) with the detections' correlated errors among the states: ``part``, Jacobians, covariances.

    ``joint`` (M, r + l, r + l) is of robot and object.
    """
    count = shape[1]
    slopes, at = np.repeat(errors.slopes, count, axis=0), np.repeat(errors.mean, count, axis=0)
    part = errors.transition.white.linearisation(part, slopes, at)
    slots = np.stack([np.zeros(count, dtype=int), 1 + np.arange(count)], axis=1)
    prior = errors.with_pairs(joint, spaces.layout.rows_of_slots(slots))
    jacobian = np.concatenate([part.jacobian_robot, part.jacobian_object, slopes[:, :, None] * np.eye(2)], axis=-1)
    size = joint.shape[-1] + 2
    return part, jacobian, prior.reshape(shape[0] * count, size, -1)


def _at_prediction(
    part: Linearisation, jacobian: Array, prior: Array, shape: tuple[int, int], tail: HeavyTail | None
) -> PairDensities:
    """Densities of all pairs, ``part`` (D M, ...); with a ``tail`` those of outliers are mixed in."""
    innovation = Innovation.of(part, jacobian, prior)
    table = _table(part, shape)
    log_density, distance = innovation.log_density.reshape(shape), innovation.distance.reshape(shape)
    if tail is None:
        return PairDensities(log_density, distance, table)
    wide = Innovation.of(part, jacobian, prior, np.where(part.measured, tail.added, 0.0))
    mixed = np.logaddexp(tail.log_rest + log_density, tail.log_share + wide.log_density.reshape(shape))
    return PairDensities(mixed, distance, table, tail=tail, outlier_distance=wide.distance.reshape(shape))


def _at_modes(
    pairs: StatePairs, bent: Index, part: Linearisation, prior: Array, shape: tuple[int, int]
) -> PairDensities:
    """Densities of all pairs, ``part`` (D M, ...), those of the ``bent`` whose mode is found relinearised there."""
    y = pairs.mode(MAX_ITERATIONS)
    is_found = pairs.is_mode(y)
    some, y, rows = pairs.select(np.flatnonzero(is_found)), y[is_found], bent[is_found]
    found = some.linearised(y)
    changed = {name: values.copy() for name, values in vars(part).items()}
    for name, values in vars(found).items():
        changed[name][rows] = values
    now, elsewhere = Linearisation(**changed), np.zeros(len(prior), dtype=bool)
    offsets = np.zeros(part.residual.shape)
    offsets[rows], elsewhere[rows] = (some.jacobian(found) @ some.tangent(y)[..., None])[..., 0], True
    innovation = Innovation.of(now, np.concatenate([now.jacobian_robot, now.jacobian_object], axis=-1), prior)
    return PairDensities(
        innovation.log_density.reshape(shape),
        innovation.distance.reshape(shape),
        _table(now, shape),
        offsets.reshape(*shape, -1),
        elsewhere.reshape(shape),
        _table(part, shape),
    )


def _table(part: Linearisation, shape: tuple[int, int]) -> Linearisation:
    """Rows (D M, ...) as a table (D, M, ...)."""
    return Linearisation(**{name: values.reshape(*shape, *values.shape[1:]) for name, values in vars(part).items()})


def _no_pairs(shape: tuple[int, int]) -> Linearisation:
    nothing = np.zeros((*shape, 0))
    slopes = nothing[..., None]
    return Linearisation(
        residual=nothing, jacobian_robot=slopes, jacobian_object=slopes, log_normaliser=np.zeros(shape)
    )


@dataclass(frozen=True)
class RankedAssignments:
    """The B best joint assignments of D detections, in descending order of score."""

    columns: Index  # (B, D) object, or M + i: detection i is of no known object
    log_scores: Array  # (B,)
    log_left_out: float  # log mass of all other assignments, relative to the best


def best_assignments(
    log_known: Array,
    admitted: NDArray[np.bool_],
    log_new: Array,
    limit: int,
    gate: float,
    log_beyond: Array | None = None,
    objects: Index | None = None,
) -> RankedAssignments:
    """The best assignments to distinct objects, at most ``limit``, none more than ``gate`` nats behind the best.

    ``log_known`` (D, M) weighs a detection as one of each object, relative to a missed detection of it; ``admitted``
    (D, M) are the pairs within the gate; ``log_new`` (D,) weighs it as one of no known object (birth or clutter).
    ``log_beyond`` (D,) weighs all options that are not among these columns: it counts only in the mass left out.
    ``objects`` (M,) are the object ids of the columns, where an object has several columns (e.g. static and moving);
    None: all are distinct.
    """
    count, known = log_known.shape
    cost = np.full((count, known + count), np.inf)
    cost[:, :known] = np.where(admitted, -log_known, np.inf)
    cost[np.arange(count), known + np.arange(count)] = -log_new
    columns, total = _cheapest(cost, limit, gate + SLACK if objects is None else np.inf)
    if objects is not None:
        possible = _distinct(columns, objects)
        columns, total = columns[possible], total[possible]
        if not len(columns):  # none of the best is possible: take the one with no known object, which always is
            columns, total = known + np.arange(count)[None], -log_new.sum(keepdims=True)
        log_known = _by_object(log_known, objects)
    scores = -total
    kept = scores >= scores[0] - gate
    columns, scores = columns[kept], scores[kept]
    others = log_new if log_beyond is None else np.logaddexp(log_new, log_beyond)
    return RankedAssignments(columns, scores, log_rest(log_sum_of_all(log_known, others), scores) - float(scores[0]))


def _distinct(columns: Index, objects: Index) -> NDArray[np.bool_]:
    """(B,) whether no object is taken twice; columns beyond the (M,) ``objects`` are distinct."""
    _, numbers = np.unique(objects, return_inverse=True)
    of_columns = np.concatenate([numbers, len(numbers) + np.arange(columns.shape[1])])
    taken = np.sort(of_columns[columns], axis=1)
    return np.asarray((taken[:, 1:] != taken[:, :-1]).all(axis=1))


def _by_object(log_known: Array, objects: Index) -> Array:
    """(D, N) log weights for N distinct objects, summed over the columns of each, from (D, M)."""
    distinct, numbers = np.unique(objects, return_inverse=True)
    summed = np.full((len(distinct), len(log_known)), -np.inf)
    np.logaddexp.at(summed, numbers, log_known.T)
    return summed.T


def may_be_more(admitted: NDArray[np.bool_], limit: int) -> bool:
    """Whether there may be more than ``limit`` joint assignments of the (D, M) ``admitted`` pairs."""
    return bool(np.prod(1.0 + admitted.sum(axis=1)) > limit)


def _cheapest(cost: Array, limit: int, within: float) -> tuple[Index, Array]:
    """At most ``limit`` assignments in order of cost: by listing all where they are few, else by Murty's algorithm.

    Murty's algorithm returns none that costs more than ``within`` beyond the cheapest.
    """
    possible = np.isfinite(cost)
    if np.prod(possible.sum(axis=1), dtype=np.float64) > limit:
        cheapest = k_best(cost, limit, within)
        return cheapest.columns, cheapest.costs
    listed = list(product(*(np.flatnonzero(row) for row in possible)))
    every = np.array(listed, dtype=int).reshape(len(listed), len(cost))
    ordered = np.sort(every, axis=1)
    distinct = every[(ordered[:, 1:] != ordered[:, :-1]).all(axis=1)]
    total = cost[np.arange(len(cost)), distinct].sum(axis=1)
    order = np.argsort(total, kind="stable")[:limit]
    return distinct[order], total[order]


def log_products(log_known: Array, log_new: Array, columns: Index) -> Array:
    """(K,) log weights of joint assignments (K, D) as products over pairs (D, C); columns >= C: no known object."""
    options = np.concatenate([log_known, log_new[:, None]], axis=1)
    return np.asarray(options[np.arange(len(options)), np.minimum(columns, log_known.shape[1])].sum(axis=1))


def log_rest(everything: float, scores: Array) -> float:
    """Log of the mass that remains of ``everything`` without the assignments of these log ``scores``."""
    enumerated = float(np.logaddexp.reduce(scores))
    share = -np.expm1(min(enumerated - everything, 0.0))
    return everything + float(np.log(share)) if share > 1e-12 else -np.inf

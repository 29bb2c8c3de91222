"""Fixed-lag marginalisation of a smoother: old poses are replaced by one summary factor over what is left."""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.callback_factor import source_of
from semantic_slam.inference.models.spatial.range_prior import StartedByRay
from semantic_slam.inference.smoothing.errors import lost_where_indeterminate
from semantic_slam.inference.smoothing.factor_table import FactorTable
from semantic_slam.inference.smoothing.past.summary import summary_of
from semantic_slam.inference.smoothing.reoptimisation import reoptimised
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.keys import bias_key, is_bias, is_object, is_robot, number_of, robot_key


def without_past(smoother: Smoother, oldest: int, object_ids: Collection[int]) -> Smoother:
    """A new smoother without robot poses before keyframe ``oldest``; this one is left unchanged.

    Objects other than ``object_ids`` that nothing observed since are marginalised too. Raises LostComponentError.
    """
    with lost_where_indeterminate("a summary of the past"):
        return _without_past(_settled(smoother), oldest, object_ids)


def _settled(smoother: Smoother) -> Smoother:
    """The smoother to marginalise: in space at the optimum of its graph, as what is linear now remains so for ever."""
    if not _is_in_space(smoother):
        return smoother
    start = smoother.isam.calculateEstimate()
    return reoptimised(smoother, smoother.kept(), smoother.factor_table.measurements, [start])


def _is_in_space(smoother: Smoother) -> bool:
    return smoother.spaces.name == "spatial"


def _without_past(smoother: Smoother, oldest: int, object_ids: Collection[int]) -> Smoother:
    held, values = smoother.isam.getFactorsUnsafe(), smoother.isam.calculateEstimate()
    slots = [slot for slot in range(held.size()) if held.exists(slot)]
    keys = {slot: held.at(slot).keys() for slot in slots}
    gone = {key for key in values.keys() if _is_past(key, oldest)}  # noqa: SIM118
    touched = {slot for slot in slots if not gone.isdisjoint(keys[slot])}
    gone |= _forgotten(keys, touched, object_ids)
    touched = {slot for slot in slots if not gone.isdisjoint(keys[slot])}
    anchors = _anchors(held, keys) if _is_in_space(smoother) else {}
    summary = summary_of(smoother.spaces, [held.at(slot) for slot in sorted(touched)], values, gone, anchors)
    semantic = set(smoother.factor_table.indices)
    kept = gtsam.NonlinearFactorGraph()
    for slot in slots:
        if slot not in touched and slot not in semantic:
            kept.add(held.at(slot))
    kept.add(summary.factor(smoother.spaces))
    rows = [row for row, slot in enumerate(smoother.factor_table.indices) if slot not in touched]
    factors = [held.at(smoother.factor_table.indices[row]) for row in rows]
    left = [key for key in values.keys() if key not in gone]  # noqa: SIM118
    restarted = smoother.restarted(kept, values.extract(left), factors, _taken(smoother.factor_table, rows))
    return replace(restarted, is_summarised=True)


def _anchors(held: gtsam.NonlinearFactorGraph, keys: dict[int, list[int]]) -> dict[int, Array]:
    """Origins (3,) in map of the rays alone that started objects, by their keys."""
    unary = [held.at(slot) for slot, own in keys.items() if len(own) == 1]
    sources = [source_of(factor) for factor in unary if isinstance(factor, gtsam.CustomFactor)]
    return {source.key: source.anchor for source in sources if isinstance(source, StartedByRay)}


def _is_past(key: int, oldest: int) -> bool:
    """Whether a variable is a robot pose before keyframe ``oldest``, or the odometry bias of an earlier stretch."""
    if is_robot(key):
        return key < robot_key(oldest)
    return is_bias(key) and key < bias_key(oldest)


def _forgotten(keys: dict[int, list[int]], touched: set[int], object_ids: Collection[int]) -> set[int]:
    """Objects not among ``object_ids`` that only marginalised factors, and unary ones, involve."""
    past = {key for slot in touched for key in keys[slot] if is_object(key) and number_of(key) not in object_ids}
    others = (own for slot, own in keys.items() if slot not in touched and len(own) > 1)
    return past - set[int]().union(*others)


def _taken(table: FactorTable, rows: list[int]) -> Any:
    """The table of the factors in ``rows``; without their indices, unless it is the whole."""
    if len(rows) == len(table):
        return table
    return FactorTable(
        measurements=tuple(table.measurements[row] for row in rows),
        points=table.points.take(rows),
        keys=table.keys[rows],
        exact=np.asarray(table.exact[rows]),
    )

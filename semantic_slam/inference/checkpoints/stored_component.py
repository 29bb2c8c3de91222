"""A component right after a marginalisation as bytes, from which an equal one is made, to the last bit.

Its iSAM2 is then a new one of all factors at one linearisation point, and is made again in the same way. GTSAM writes
its own factors with 17 digits; factors with a callback are made again from their source. Priors of positions alone are
written one by one: GTSAM's graphs do not know how to.
"""

from dataclasses import dataclass, fields, replace
from typing import Any

import gtsam

from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.inference.models.callback_factor import source_of
from semantic_slam.inference.models.custom_factor import Sighting
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.odometry_bias import BiasedMotion, biased_factor
from semantic_slam.inference.models.spatial.range_prior import StartedByRay
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.factor_table import FactorTable
from semantic_slam.inference.smoothing.past.summary import Summary
from semantic_slam.inference.smoothing.smoother import Smoother

SHARED = ("spaces", "model", "smoother")
"""Fields of a component that its root has, too, or that are stored otherwise."""


@dataclass(frozen=True, kw_only=True)
class StoredSmoother:
    """The factors of a new smoother, semantic ones last, and where all are linearised."""

    factors: str  # GTSAM's text of those that it can write
    sources: dict[int, Any]  # place among all factors -> source of one with a callback, or GTSAM's text of one factor
    values: str  # GTSAM's text of the linearisation point
    table: FactorTable
    along_rays: bool


def stored(component: Component) -> bytes:
    """The bytes of a component whose smoother is new. Raises TypeError where some part of it cannot be stored."""
    told = {own.name: getattr(component, own.name) for own in fields(Component) if own.init}
    rest = {name: value for name, value in told.items() if name not in SHARED}
    return packed((rest, _stored_smoother(component.smoother)))


def restored(data: bytes, root: Component) -> Component:
    """The component of :func:`stored` bytes; ``root`` is one of the same problem. Raises ValueError for other bytes."""
    try:
        rest, smoother = unpacked(data)
        return Component(spaces=root.spaces, model=root.model, smoother=_restored_smoother(smoother, root), **rest)
    except (RuntimeError, TypeError, AttributeError) as fault:
        raise ValueError(f"no component of this version ({type(fault).__name__})") from None


def _stored_smoother(smoother: Smoother) -> StoredSmoother:
    held, native, sources = smoother.isam.getFactorsUnsafe(), gtsam.NonlinearFactorGraph(), {}
    num_others = held.size() - len(smoother.factor_table)
    if smoother.factor_table.indices != tuple(range(num_others, held.size())):
        raise TypeError("a smoother that is not new cannot be stored")
    for place in range(held.size()):
        factor = held.at(place)
        if isinstance(factor, gtsam.CustomFactor):
            sources[place] = source_of(factor)
        elif isinstance(factor, gtsam.PoseTranslationPrior2D):
            sources[place] = factor.serialize()
        else:
            native.add(factor)
    return StoredSmoother(
        factors=native.serialize(),
        sources=sources,
        values=smoother.isam.getLinearizationPoint().serialize(),
        table=smoother.factor_table,
        along_rays=smoother.along_rays,
    )


def _restored_smoother(told: StoredSmoother, root: Component) -> Smoother:
    native, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    native.deserialize(told.factors)
    values.deserialize(told.values)
    size = native.size() + len(told.sources)
    others = iter(range(native.size()))
    factors = [
        _made_again(told.sources[place], root) if place in told.sources else native.at(next(others))
        for place in range(size)
    ]
    kept = gtsam.NonlinearFactorGraph()
    for factor in factors[: size - len(told.table)]:
        kept.add(factor)
    semantic = factors[size - len(told.table) :]
    empty = replace(root.smoother, along_rays=told.along_rays)
    return replace(empty.restarted(kept, values, semantic, told.table), is_summarised=True)


def _made_again(source: Any, root: Component) -> Any:
    """A factor with a callback, from what it was made of, or the one that GTSAM has written by itself."""
    if isinstance(source, str):
        position = gtsam.PoseTranslationPrior2D(0, gtsam.Pose2(), unit_noise(2))
        position.deserialize(source)
        return position
    if isinstance(source, Summary):
        return source.factor(root.spaces)
    if isinstance(source, BiasedMotion):
        return biased_factor(source.keys, source.control, source.covariance, source.by_bias)
    if isinstance(source, Sighting):
        return root.model.geometry_factor(source.detection, source.keys)
    if isinstance(source, StartedByRay):
        return source.prior.factor(root.spaces.landmark, source.key)
    raise TypeError(f"{type(source).__name__} is no source of a factor")

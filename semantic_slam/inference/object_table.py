"""What is known of every object, quantity by quantity: the one declaration of all that a run tells per object.

A new quantity is a field of :class:`ObjectTable`, the line of the module that finds its values (a backend's
``_report`` or what fills the table there), and a line in Components.msg and HybridBelief.msg. The rows of a backend's
answer, their alignment over other objects, the layouts of both messages, the mixture and the belief derive from it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.moments import matched_moments_of_many
from semantic_slam.geometry.optional_arrays import left_out
from semantic_slam.inference import mixture_rules

CLASS_PRIOR = "class prior"
"""What stands where a hypothesis has no such object, for a quantity that is a distribution over classes."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """How one per-object quantity is laid out, filled where an object is absent, and stated for a mixture."""

    shape: tuple[str | int, ...]  # of one object; C classes, L descriptor dimensions
    absent: float | str  # value where a hypothesis has no such object, or CLASS_PRIOR
    dtype: Any = np.float64
    rule: Callable[..., Any] | None = None  # of mixture_rules; None: another quantity's rule gives it as its spread
    spread: str = ""  # quantity that ``rule`` takes as a second one and gives back as a second one
    may_be_left_out: bool = False


def quantity(*shape: str | int, absent: float | str = np.nan, **declared: Any) -> dict[str, Quantity]:
    """Metadata of a field of :class:`ObjectTable`; the arguments are those of :class:`Quantity`."""
    return {"quantity": Quantity(shape=shape, absent=absent, **declared)}


def optional_quantity(*shape: int) -> dict[str, Quantity]:
    """Metadata of a field that has no values (size 0) unless the configured model finds them."""
    return quantity(*shape, rule=mixture_rules.mean_where_known, may_be_left_out=True)


@dataclass(frozen=True, kw_only=True)
class ObjectTable:
    """Quantities of O objects under S hypotheses, (S, O, ...), under one of them, or of their mixture, (O, ...)."""

    object_poses: Array = field(metadata=quantity(7, rule=matched_moments_of_many, spread="object_covariances"))  # map
    object_covariances: Array = field(metadata=quantity(6, 6))
    class_probabilities: Array = field(  # one-hot where the class is enumerated, the prior where nothing was seen
        metadata=quantity("C", absent=CLASS_PRIOR, rule=mixture_rules.mean)
    )
    mutual_information: Array = field(metadata=quantity(rule=mixture_rules.mean_where_known))  # nats, NaN: not seen
    in_coverage: NDArray[np.bool_] = field(  # no more views outside the class models' coverage than by chance
        metadata=quantity(absent=True, dtype=np.bool_, rule=mixture_rules.of_most)
    )
    forgotten_views: NDArray[np.uint32] = field(  # views that a new one is no longer correlated with
        metadata=quantity(absent=0, dtype=np.uint32, rule=mixture_rules.of_the_best)
    )
    existence: Array = field(metadata=quantity(rule=mixture_rules.probability))
    descriptors: Array = field(  # of a learned latent space, what is known before the first view until then
        metadata=quantity("L", rule=mixture_rules.diagonal_moments, spread="descriptor_covariances")
    )
    descriptor_covariances: Array = field(metadata=quantity("L"))  # diagonal
    moving: Array = field(default_factory=left_out, metadata=optional_quantity())  # probability that it moves
    moved: Array = field(default_factory=left_out, metadata=optional_quantity())  # that it stood elsewhere before
    missing: Array = field(default_factory=left_out, metadata=optional_quantity())  # that it is gone
    object_velocities: Array = field(default_factory=left_out, metadata=optional_quantity(6))  # in map, m/s and rad/s


QUANTITIES: Mapping[str, Quantity] = {item.name: item.metadata["quantity"] for item in fields(ObjectTable)}
OPTIONAL = tuple(name for name, item in QUANTITIES.items() if item.may_be_left_out)


def columns(table: ObjectTable) -> dict[str, NDArray[Any]]:
    """The quantities of a table, or of what has them among its fields, by name."""
    return {name: getattr(table, name) for name in QUANTITIES}


def without_views(count: int, class_prior: Array, **known: NDArray[Any]) -> ObjectTable:
    """Table of ``count`` hypotheses as if nothing was seen of O objects, from their (O, C) prior, and what is known."""
    shape = (count, len(class_prior))
    blank = {
        name: _full(shape, item, class_prior)
        for name, item in QUANTITIES.items()
        if name not in known and not item.may_be_left_out
    }
    return ObjectTable(**blank, **known)


def table_row(table: ObjectTable, index: int) -> ObjectTable:
    """One hypothesis of a table."""
    return ObjectTable(
        **{name: values if _is_left_out(name, values) else values[index] for name, values in columns(table).items()}
    )


def stack_rows(rows: Sequence[ObjectTable]) -> ObjectTable:
    """Hypotheses over the same objects as one table."""
    return ObjectTable(**{name: _stacked([getattr(one, name) for one in rows], name) for name in QUANTITIES})


def over(table: ObjectTable, places: Index, class_prior: Array) -> ObjectTable:
    """A table over more objects, of which those of ``table`` are the ``places``; the others are absent from it."""

    def spread(name: str, values: NDArray[Any]) -> NDArray[Any]:
        if _is_left_out(name, values):
            return values
        full = _full((len(values), len(class_prior)), QUANTITIES[name], class_prior, values.shape[2:])
        if values.size:  # a message that holds no component does not say how many classes there are
            full[:, places] = values
        return full

    return ObjectTable(**{name: spread(name, values) for name, values in columns(table).items()})


def marginals(weights: Array, table: ObjectTable) -> dict[str, Any]:
    """The quantities of the mixture of H hypotheses, (O, ...) each, from their (H,) weights."""
    mixture: dict[str, Any] = {}
    for name, item in QUANTITIES.items():
        values = getattr(table, name)
        if item.rule is None:
            continue
        if item.spread:
            mixture[name], mixture[item.spread] = item.rule(weights, values, getattr(table, item.spread))
        else:
            mixture[name] = values if _is_left_out(name, values) else item.rule(weights, values)
    return mixture


def _full(
    shape: tuple[int, int], item: Quantity, class_prior: Array, trailing: tuple[int, ...] | None = None
) -> NDArray[Any]:
    """(S, O, ...) as it is where objects are absent; ``trailing``: sizes of the letters other than C."""
    if item.absent == CLASS_PRIOR:
        return np.repeat(class_prior[None], shape[0], axis=0)
    sizes = tuple(size for size in item.shape if isinstance(size, int)) if trailing is None else trailing
    return np.full((*shape, *sizes), item.absent, dtype=item.dtype)


def _is_left_out(name: str, values: NDArray[Any]) -> bool:
    return QUANTITIES[name].may_be_left_out and not values.size


def _stacked(values: list[NDArray[Any]], name: str) -> NDArray[Any]:
    """Rows as one array; a backend that could not tell of any object leaves the other backends' values alone."""
    shape = next((one.shape for one in values if not _is_left_out(name, one)), None)
    if shape is None:
        return np.zeros(0)
    return np.array([np.full(shape, np.nan) if _is_left_out(name, one) else one for one in values])

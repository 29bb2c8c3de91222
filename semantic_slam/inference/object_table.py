"""The per-object quantities of a belief: the single declaration from which tables, messages and mixtures derive.

To add a quantity, add a field to :class:`ObjectTable`, compute its values (in a backend's ``_report`` or in what fills
the table there), and add a line to Components.msg and HybridBelief.msg. The rows of a backend's answer, their alignment
to a larger set of objects, the layouts of both messages, the mixture and the belief are derived from the declaration.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.moments import matched_moments_of_many
from semantic_slam.geometry.optional_arrays import left_out
from semantic_slam.inference import mixture_rules

CLASS_PRIOR = "class prior"
"""Value of ``Quantity.absent`` for a distribution over classes: an absent object has its prior."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Declaration of one per-object quantity: its shape, its fill value, and how it is mixed over hypotheses."""

    shape: tuple[str | int, ...]  # of one object; C classes, L descriptor dimensions
    absent: float | str  # value where a hypothesis has no such object, or CLASS_PRIOR
    dtype: Any = np.float64
    rule: Callable[..., Any] | None = None  # from mixture_rules; None: computed by another quantity's rule (``spread``)
    given_existence: bool = False  # ``rule`` takes the objects' existence, too
    spread: str = ""  # name of the quantity that ``rule`` takes and returns beside this one: its covariance
    may_be_left_out: bool = False  # it has no values (size 0) unless the configured model fills it


def quantity(*shape: str | int, absent: float | str = np.nan, **declared: Any) -> dict[str, Quantity]:
    """Metadata of a field of :class:`ObjectTable`, from the arguments of :class:`Quantity`."""
    return {"quantity": Quantity(shape=shape, absent=absent, **declared)}


def motion_quantity(*shape: int) -> dict[str, Quantity]:
    """Metadata of how an object moves, given that it exists; without values (size 0) where nothing may move."""
    rule = mixture_rules.mean_if_it_exists
    return quantity(*shape, rule=rule, given_existence=True, may_be_left_out=True)


@dataclass(frozen=True, kw_only=True)
class ObjectTable:
    """Quantities of O objects: (S, O, ...) under S hypotheses, or (O, ...) under one of them or for the mixture."""

    object_poses: Array = field(metadata=quantity(7, rule=matched_moments_of_many, spread="object_covariances"))  # map
    object_covariances: Array = field(metadata=quantity(6, 6))  # along the axes of map
    class_probabilities: Array = field(  # one-hot where classes are enumerated, the prior where nothing was seen
        metadata=quantity("C", absent=CLASS_PRIOR, rule=mixture_rules.mean)
    )
    mutual_information: Array = field(metadata=quantity(rule=mixture_rules.mean_where_known))  # nats, NaN: not seen
    in_coverage: NDArray[np.bool_] = field(  # False: more views out of the class models' coverage than by chance
        metadata=quantity(absent=True, dtype=np.bool_, rule=mixture_rules.of_most)
    )
    forgotten_views: NDArray[np.uint32] = field(  # number of old views whose correlation with new ones is dropped
        metadata=quantity(absent=0, dtype=np.uint32, rule=mixture_rules.of_the_best)
    )
    existence: Array = field(metadata=quantity(rule=mixture_rules.probability))  # probability of existence
    descriptors: Array = field(  # mean in a learned latent space; the prior until the first view
        metadata=quantity("L", rule=mixture_rules.diagonal_moments, spread="descriptor_covariances")
    )
    descriptor_covariances: Array = field(metadata=quantity("L"))  # diagonal
    moving: Array = field(default_factory=left_out, metadata=motion_quantity())  # P(it moves | it exists)
    moved: Array = field(  # probability that it was moved since mapping
        default_factory=left_out, metadata=quantity(rule=mixture_rules.mean_where_known, may_be_left_out=True)
    )
    missing: Array = field(  # that it existed, and has left for good
        default_factory=left_out, metadata=quantity(rule=mixture_rules.probability_if_known, may_be_left_out=True)
    )
    track_scores: Array = field(  # log odds that its detections are of one thing, and not all false alarms
        default_factory=left_out, metadata=quantity(rule=mixture_rules.of_the_best, may_be_left_out=True)
    )
    object_velocities: Array = field(  # given that it exists, in map, m/s and rad/s
        default_factory=left_out, metadata=motion_quantity(6)
    )

    @property
    def existed(self) -> Array:
        """Probability that an object exists, or has left; NaN where a hypothesis has no such object."""
        return self.existence + np.nan_to_num(self.missing) if self.missing.size else self.existence

    def existing(self, factors: Array) -> Self:
        """The table with ``factors`` on the probabilities that objects exist, and that they have left."""
        missing = self.missing * factors if self.missing.size else self.missing
        return replace(self, existence=self.existence * factors, missing=missing)


QUANTITIES: Mapping[str, Quantity] = {item.name: item.metadata["quantity"] for item in fields(ObjectTable)}
OPTIONAL = tuple(name for name, item in QUANTITIES.items() if item.may_be_left_out)


def columns(table: ObjectTable) -> dict[str, NDArray[Any]]:
    """The quantities of a table by name; also of a subclass such as ``HybridBelief``."""
    return {name: getattr(table, name) for name in QUANTITIES}


def without_views(count: int, class_prior: Array, **known: NDArray[Any]) -> ObjectTable:
    """A table of ``count`` hypotheses over O objects without any view: the (O, C) class prior and fill values.

    Quantities given in ``known`` are taken as they are.
    """
    shape = (count, len(class_prior))
    blank = {
        name: _full(shape, item, class_prior)
        for name, item in QUANTITIES.items()
        if name not in known and not item.may_be_left_out
    }
    return ObjectTable(**blank, **known)


def table_row(table: ObjectTable, index: int) -> ObjectTable:
    """The table (O, ...) of one hypothesis."""
    return ObjectTable(
        **{name: values if _is_left_out(name, values) else values[index] for name, values in columns(table).items()}
    )


def stack_rows(rows: Sequence[ObjectTable]) -> ObjectTable:
    """Stack the tables of single hypotheses over the same objects into one."""
    return ObjectTable(**{name: _stacked([getattr(one, name) for one in rows], name) for name in QUANTITIES})


def over(table: ObjectTable, places: Index, class_prior: Array) -> ObjectTable:
    """Extend a table to more objects: its own take the rows ``places``, the others get the values of absent ones."""

    def spread(name: str, values: NDArray[Any]) -> NDArray[Any]:
        if _is_left_out(name, values):
            return values
        full = _full((len(values), len(class_prior)), QUANTITIES[name], class_prior, values.shape[2:])
        if values.size:  # a message without components does not state the number of classes
            full[:, places] = values
        return full

    return ObjectTable(**{name: spread(name, values) for name, values in columns(table).items()})


def marginals(weights: Array, table: ObjectTable) -> dict[str, Any]:
    """The quantities (O, ...) of the mixture of H hypotheses with (H,) weights, by the rule of each."""
    mixture: dict[str, Any] = {}
    for name, item in QUANTITIES.items():
        values = getattr(table, name)
        if item.rule is None:
            continue
        if item.spread:
            mixture[name], mixture[item.spread] = item.rule(weights, values, getattr(table, item.spread))
        else:
            besides = (table.existence,) if item.given_existence else ()
            mixture[name] = values if _is_left_out(name, values) else item.rule(weights, values, *besides)
    return mixture


def _full(
    shape: tuple[int, int], item: Quantity, class_prior: Array, trailing: tuple[int, ...] | None = None
) -> NDArray[Any]:
    """(S, O, ...) fill values of absent objects; ``trailing``: the sizes of the dimensions after O, None: declared."""
    if item.absent == CLASS_PRIOR:
        return np.repeat(class_prior[None], shape[0], axis=0)
    sizes = tuple(size for size in item.shape if isinstance(size, int)) if trailing is None else trailing
    return np.full((*shape, *sizes), item.absent, dtype=item.dtype)


def _is_left_out(name: str, values: NDArray[Any]) -> bool:
    return QUANTITIES[name].may_be_left_out and not values.size


def _stacked(values: list[NDArray[Any]], name: str) -> NDArray[Any]:
    """Stack rows into one array; left-out ones become NaN where another backend has values, size 0 if none has."""
    shape = next((one.shape for one in values if not _is_left_out(name, one)), None)
    if shape is None:
        return np.zeros(0)
    return np.array([np.full(shape, np.nan) if _is_left_out(name, one) else one for one in values])

"""Reassociation in the graph: detections of long ago are assigned to other objects without replaying the drive.

Where iSAM2 holds measurements linear, the object of a detection is an id stored with it: the ids are changed, and the
whole graph is solved again. Objects that are to be merged are first pulled together by auxiliary factors between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.smoothing.errors import lost_where_indeterminate
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearFactors
from semantic_slam.inference.smoothing.linear.measured import Sightings
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.smoothing.solver.isam import OwnedIsam, single_step_isam
from semantic_slam.inference.smoothing.solver.relinearisation import relinearised
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import detection_of, object_key

TOGETHER_M, ANY_TURN_RAD = 1e-2, 10.0
"""Standard deviations of position [m] and heading [rad] between two objects in the factors that pull them together."""


@dataclass(frozen=True)
class Sighted:
    """All n detections held by a smoother, in its order."""

    keyframes: Index  # (n,)
    numbers: Index  # (n,) number of each within its keyframe
    objects: Index  # (n,)

    @classmethod
    def of(cls, smoother: Smoother) -> Self:
        """The detections of a smoother whose measurements are held linear."""
        sightings = _sightings(smoother)
        if sightings is None:
            nothing = np.zeros(0, dtype=int)
            return cls(nothing, nothing, nothing)
        pairs = zip(sightings.keys.tolist(), sightings.firsts.tolist(), strict=True)
        numbers = np.array([detection_of(key, first) for key, first in pairs], dtype=int)
        return cls(sightings.rows - 1, numbers, sightings.ids)


def reassociated(smoother: Smoother, objects: Index, started: Mapping[int, GaussianPrior]) -> Smoother:
    """A new smoother in which the detections are of ``objects`` (n,); this one is left unchanged.

    ``started``: priors of objects that are new, which start at the priors' means. Raises LostComponentError.
    """
    assert smoother.in_charts is not None
    with lost_where_indeterminate("a revision"):
        isam, factors = relinearised(*_renamed(smoother, objects, started))
        size = int(isam.calculateEstimate().size())
    return replace(smoother, owned=OwnedIsam(isam), in_charts=factors, num_variables=size, _here=[])


def brought_together(smoother: Smoother, pairs: Sequence[tuple[int, int]]) -> Smoother:
    """A new smoother in which both objects of each pair are pulled to one place. Raises LostComponentError."""
    before, space = smoother.in_charts, smoother.spaces.landmark
    assert before is not None
    apart = np.full(space.tangent_size, TOGETHER_M**2)
    apart[2:] = ANY_TURN_RAD**2
    graph = gtsam.NonlinearFactorGraph()
    for one, other in pairs:
        nothing = np.zeros(space.storage_size)
        graph.add(space.between_factor(object_key(one), object_key(other), nothing, np.diag(apart)))
    isam = gtsam.ISAM2(smoother.isam)
    with lost_where_indeterminate("a revision"):
        isam.update(graph, gtsam.Values())
        factors = replace(before, num_slots=before.num_slots + graph.size())
        isam, factors = relinearised(isam, factors)
    return replace(smoother, owned=OwnedIsam(isam), in_charts=factors, _here=[])


def log_evidence(smoother: Smoother) -> float:
    """Log of the integral of all factors over all variables, as a Gaussian at the estimate (Laplace).

    It leaves out (2 pi)^(1/2) per dimension, which depends on associations by the number of variables alone.
    """
    graph = smoother.isam.getFactorsUnsafe().linearize(smoother.isam.getLinearizationPoint())
    tree = graph.eliminateMultifrontal()
    solution = tree.optimize()
    return -float(graph.error(solution)) - float(tree.logDeterminant())


def _sightings(smoother: Smoother) -> Sightings | None:
    """All detections in one batch; None without any."""
    assert smoother.in_charts is not None
    found = [own.of for own in smoother.in_charts.joined if isinstance(own.of, Sightings)]
    return found[0] if found else None


def _renamed(
    smoother: Smoother, objects: Index, started: Mapping[int, GaussianPrior]
) -> tuple[gtsam.ISAM2, LinearFactors]:
    """An iSAM2 of all factors at the estimate, with the new object ids and without priors of objects that are gone."""
    before = smoother.in_charts
    assert before is not None
    before = before.in_one_part()
    held, spaces = smoother.isam.getFactorsUnsafe(), smoother.spaces
    measured = np.zeros(before.num_slots, dtype=bool)
    for own in before.joined:
        measured[own.slots] = True
    estimate = smoother.isam.calculateEstimate()
    values = before.charts.values(before.charts.located(smoother.isam.getDelta().vector()), estimate)
    old = _sightings(smoother)
    gone = set() if old is None else {object_key(int(n)) for n in np.setdiff1d(old.ids, objects)}
    for key in gone:
        values.erase(key)
    graph = gtsam.NonlinearFactorGraph()
    for slot in np.flatnonzero(~measured).tolist():
        if not gone & set(held.at(slot).keys()):
            graph.add(held.at(slot))
    for number, prior in started.items():
        for factor in prior.factors(spaces.landmark, object_key(number)):
            graph.add(factor)
        spaces.landmark.insert(values, object_key(number), prior.mean)
    others = graph.size()
    renamed = replace(before, parts=tuple(tuple(_with_ids(own, objects) for own in kind) for kind in before.parts))
    empty, made = renamed.about(values)
    for own in made:
        graph.push_back(own.factors())
    factorization = smoother.isam.params().getFactorization()
    fresh = single_step_isam(spaces, errors_repeat=True, factorization=factorization)
    fresh.update(graph, values)
    return fresh, empty.with_new(made, others)


def _with_ids(own: Any, objects: Index) -> Any:
    return replace(own, of=replace(own.of, ids=objects)) if isinstance(own.of, Sightings) else own

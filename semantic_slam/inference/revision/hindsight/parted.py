"""Mixtures: objects whose detections are of two things, those of one run of sightings and those of the others.

Each part has a place of its own, by its detections and the path as now known. What parting them gains is the inverse of
what joining them would: the intensity of births there, over the density of their relative position at nothing.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.hindsight.joined import log_at_nothing, log_misses, log_of_birth
from semantic_slam.inference.revision.returns.runs import Runs
from semantic_slam.inference.states.lineage import Lineage

LEAST_DETECTIONS = 2
"""Detections of either part: a thing that is seen once may be a false alarm as well."""
RANGE_SIGMA_M = 1.0
"""Standard deviation of the place of a part along rays that tell nothing of their range."""


@dataclass(frozen=True)
class Parted:
    """Sightings that may be of another thing than the rest of their object."""

    object_id: int
    first: int  # keyframe of the first of these sightings
    gains: Array  # (T,) rough log gain of the history with them parted, of each keyframe
    times: Flags  # (T,) when they were

    @property
    def gain(self) -> float:
        """Rough log gain of the whole history."""
        return float(self.gains.sum())

    def history(self, view: Hindsight) -> Lineage:
        """The history in which they are of a new object."""
        new = view.registry.first_new_id(self.first) + view.lineage[self.first].association.index(self.object_id)
        names = {self.object_id: new}
        return tuple(
            replace(step, association=tuple(names.get(n, n) for n in step.association)) if is_parted else step
            for step, is_parted in zip(view.lineage, self.times.tolist(), strict=True)
        )


def parted(view: Hindsight, least: float) -> list[Parted]:
    """Objects that gain more than ``least`` [nats] parted, the likeliest parting of each; largest gain first."""
    best: dict[int, Parted] = {}
    for own in _partings(view):
        if own.gain > max(least, best[own.object_id].gain if own.object_id in best else least):
            best[own.object_id] = own
    return sorted(best.values(), key=lambda own: -own.gain)


def _partings(view: Hindsight) -> Iterator[Parted]:
    keyframes, numbers, rows = _detections(view)
    runs = Runs.of(rows, keyframes, 0, len(view.steps))
    residuals, slopes = _linearised(view, keyframes, numbers, rows)
    for parting in runs.partings():
        row, new = parting.parted
        own, other = (np.flatnonzero((rows == row) & (parting.objects[runs.detections] == end)) for end in (row, new))
        if min(len(own), len(other)) < LEAST_DETECTIONS or int(view.ids[row]) in view.problem.map_ids:
            continue
        place, spread = _place(residuals[own], slopes[own])
        place_of_other, spread_of_other = _place(residuals[other], slopes[other])
        log_place = float(log_at_nothing((place_of_other - place)[None], (spread + spread_of_other)[None])[0])
        times = [np.isin(np.arange(len(view.steps)), keyframes[part]) for part in (own, other)]
        yield Parted(int(view.ids[row]), int(keyframes[other[0]]), _gains(view, row, times[0], times[1], log_place), times[1])


def _detections(view: Hindsight) -> tuple[Index, Index, Index]:
    """(n,) keyframes of all detections of objects, their numbers in their frames, and the rows of the objects."""
    found = [
        (keyframe, number, row)
        for keyframe, owners in enumerate(view.owners)
        for number, row in enumerate(owners.tolist())
        if row < len(view.ids)
    ]
    keyframes, numbers, rows = np.array(found, dtype=int).reshape(-1, 3).T
    return keyframes, numbers, rows


def _linearised(view: Hindsight, keyframes: Index, numbers: Index, rows: Index) -> tuple[Array, Array]:
    """(n, m) whitened residuals of detections at their object's place, and (n, m, p) their Jacobians by its position."""
    model, landmark = view.problem.model, view.problem.spaces.landmark
    seen = [view.steps[k].detections[number] for k, number in zip(keyframes.tolist(), numbers.tolist(), strict=True)]
    places = view.places[rows][:, : landmark.storage_size]
    part = model.geometry(model.collect(seen), view.path[keyframes], places)
    back = np.swapaxes(landmark.position_slopes(places), 1, 2)
    return part.residual, part.jacobian_object @ back


def _place(residuals: Array, slopes: Array) -> tuple[Array, Array]:
    """(p,) most likely step of a thing from where its object is, by its detections alone, and (p, p) its covariance."""
    precision = np.einsum("nmp,nmq->pq", slopes, slopes) + np.eye(slopes.shape[2]) / RANGE_SIGMA_M**2
    covariance = np.linalg.inv(precision)
    return -covariance @ np.einsum("nmp,nm->p", slopes, residuals), covariance


def _gains(view: Hindsight, row: int, times: Flags, others: Flags, log_place: float) -> Array:
    """(T,) gains of each keyframe, with detections at ``times`` and those of the other part at ``others`` (T,)."""
    number = int(view.ids[row])
    gains = log_misses(view, row, times) + log_misses(view, row, others) - log_misses(view, row, times | others)
    gains[int(np.argmax(others))] += log_of_birth(view)
    gains[others] -= (log_place + view.log_of_one(number, number)) / others.sum()
    return gains

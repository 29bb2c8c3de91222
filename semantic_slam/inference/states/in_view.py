"""Whether an object is in view (in the sensor's region and not occluded) repeats from keyframe to keyframe.

A robot at rest sees an object at the edge of its view in every keyframe or in none. Being in view is a two-state Markov
chain: each keyframe gives the probability to be in view in the keyframe before, in this one, and in both. Beside it,
where misses come in runs, runs the chain of detectability (``MissRuns``), independent of it a priori. Each hypothesis
carries what its detections and misses say of both: the forward algorithm beside the Bernoulli existence.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.states.miss_runs import MissRuns

LEAST = 1e-12
"""Probability below which a state counts as excluded."""
LARGEST_RATIO = 1e12
"""Largest likelihood ratio against being in view."""


class InViewProbabilities(NamedTuple):
    """Probabilities of N objects to be in view, (..., N), by their places alone."""

    before: Array  # in the keyframe before
    now: Array
    both: Array

    def at(self, rows: Index, columns: Index) -> "InViewProbabilities":
        """Probabilities of some of (K, N) objects."""
        return InViewProbabilities(*(own[rows, columns] for own in self))


@dataclass(frozen=True, kw_only=True)
class InViewRecord:
    """What detections and misses so far say of O objects, if they exist, after a keyframe; G sensor settings."""

    hidden: Array  # (O, G) likelihood ratio of having been out of view in that keyframe to having been in view
    unoccluded: Array  # (O,) probability that nothing occluded them in that keyframe
    detectable: Array | None  # (O, G) probability to be detectable next, if in view in that keyframe; None: always
    detectable_hidden: Array | None  # (O, G) the same, if out of view

    @classmethod
    def unknown(cls, detectable: Array | None, num_objects: int, num_rates: int) -> "InViewRecord":
        """The record of objects that no keyframe has concerned; ``detectable`` (O, G) a priori."""
        return cls(
            hidden=np.ones((num_objects, num_rates)),
            unoccluded=np.ones(num_objects),
            detectable=detectable,
            detectable_hidden=detectable,
        )

    def take(self, rows: Index | Flags) -> "InViewRecord":
        """The record of some of the objects."""
        return InViewRecord(
            hidden=self.hidden[rows],
            unoccluded=self.unoccluded[rows],
            detectable=_some(self.detectable, rows),
            detectable_hidden=_some(self.detectable_hidden, rows),
        )

    def with_rates(self, rates: Index | Flags) -> "InViewRecord":
        """The record under some of the sensor settings: flags (G,), or numbers any number of times."""
        columns = np.s_[:, rates]
        return replace(
            self,
            hidden=self.hidden[columns],
            detectable=_some(self.detectable, columns),
            detectable_hidden=_some(self.detectable_hidden, columns),
        )

    def unreached(self, runs: MissRuns) -> "InViewRecord":
        """The record after a keyframe whose sensor reached none of the objects."""
        out = None if self.detectable_hidden is None else runs.next(self.detectable_hidden)
        return InViewRecord.unknown(out, *self.hidden.shape)

    def started(self, count: int, runs: MissRuns) -> "InViewRecord":
        """The record of ``count`` objects that the keyframe has detected first."""
        shape = count, self.hidden.shape[1]
        inside = outside = None
        if self.detectable is not None:
            inside, outside = runs.next(np.ones(shape)), np.broadcast_to(runs.share, shape)
        return InViewRecord(
            hidden=np.zeros(shape), unoccluded=np.ones(count), detectable=inside, detectable_hidden=outside
        )

    def updated(self, rows: Index, others: "InViewRecord") -> "InViewRecord":
        """The table with ``others`` in some of its rows."""
        return InViewRecord(
            hidden=_with_rows(self.hidden, rows, others.hidden),
            unoccluded=_with_rows(self.unoccluded, rows, others.unoccluded),
            detectable=None if self.detectable is None else _with_rows(self.detectable, rows, others.detectable),
            detectable_hidden=None
            if self.detectable_hidden is None
            else _with_rows(self.detectable_hidden, rows, others.detectable_hidden),
        )

    def joined(self, others: "InViewRecord") -> "InViewRecord":
        """The table, then ``others``."""
        return InViewRecord(
            hidden=np.concatenate([self.hidden, others.hidden]),
            unoccluded=np.concatenate([self.unoccluded, others.unoccluded]),
            detectable=_joined(self.detectable, others.detectable),
            detectable_hidden=_joined(self.detectable_hidden, others.detectable_hidden),
        )

    def predicted(
        self, overlap: InViewProbabilities, unoccluded: Array, chance: Array, runs: MissRuns
    ) -> "PredictedDetections":
        """What a keyframe will detect, before its detections, of N = O objects from each of K poses.

        ``unoccluded`` (K, N): probability that nothing occludes them. ``chance`` (K, N, G): mean detection probability
        of objects in view.
        """
        before, now, both = (own[..., None] for own in overlap)
        joint = both - before * now
        total = before + (1.0 - before) * self.hidden
        in_view = now + joint * (1.0 - self.hidden) / np.maximum(total, LEAST)
        in_view = np.clip(in_view, 0.0, 1.0)
        inside, outside = self._detectable_next(before, now, both)
        found = chance if inside is None else chance * (inside / runs.share)
        return PredictedDetections(in_view, found, overlap.now, unoccluded, inside, outside)

    def seen(self, expected: InViewProbabilities, found: InViewProbabilities, chance: Array, runs: MissRuns) -> Array:
        """(O, G) ratio of the probability of what was missed and is detected now to that of what was missed.

        ``expected`` (O,) by the places before the detections, ``found`` (O,) by those given them; ``chance`` (O, G) as
        in :meth:`predicted`. Without misses it is the mean detection probability over the places given the detection.
        """
        before, now, both = (own[:, None] for own in found)
        expected_before = expected.before[:, None]
        in_view = both + np.maximum(now - both, 0.0) * self.hidden
        missed = expected_before + (1.0 - expected_before) * self.hidden
        inside, _ = self._detectable_next(before, now, both)
        detected = chance if inside is None else chance * (inside / runs.share)
        return np.where(missed > LEAST, in_view / np.maximum(missed, LEAST), now) * detected

    def _detectable_next(self, before: Array, now: Array, both: Array) -> tuple[Array | None, Array | None]:
        """(K, N, G) detectability of objects in view, and out of view."""
        if self.detectable is None or self.detectable_hidden is None:
            return None, None
        appears, leaves = np.maximum(now - both, 0.0) * self.hidden, np.maximum(before - both, 0.0)
        stays_out = np.maximum(1.0 - before - now + both, 0.0) * self.hidden
        return (
            _mixed(both, self.detectable, appears, self.detectable_hidden, self.detectable_hidden),
            _mixed(leaves, self.detectable, stays_out, self.detectable_hidden, self.detectable),
        )


class PredictedDetections(NamedTuple):
    """How probably robots at K poses detect N objects, given the keyframes before; G sensor settings."""

    in_view: Array  # (K, N, G) probability to be in view
    chance: Array  # (K, N, G) detection probability of an object in view
    by_place: Array  # (K, N) probability to be in view by the places alone, whatever was missed before
    unoccluded: Array  # (K, N) probability that nothing occludes them
    detectable: Array | None  # (K, N, G) probability to be detectable, if in view; None: always
    detectable_hidden: Array | None  # (K, N, G) the same, if out of view

    @property
    def detected(self) -> Array:
        """(K, N, G) detection probabilities of objects that exist."""
        return np.asarray(self.in_view * self.chance)

    def of(self, number: int) -> "PredictedDetections":
        """The predictions from one of the poses, K = 1."""
        own = slice(number, number + 1)
        return PredictedDetections(
            in_view=self.in_view[own],
            chance=self.chance[own],
            by_place=self.by_place[own],
            unoccluded=self.unoccluded[own],
            detectable=_some(self.detectable, own),
            detectable_hidden=_some(self.detectable_hidden, own),
        )

    def after(self, seen: Flags, runs: MissRuns) -> InViewRecord:
        """The record after the keyframe, from the only pose: (N,) objects were ``seen``, the others missed."""
        found, in_view, by_place = self.chance[0], self.in_view[0], self.by_place[0][:, None]
        decided = (by_place < LEAST) | (by_place > 1.0 - LEAST)
        odds = (1.0 - in_view) * by_place / np.maximum((1.0 - by_place) * in_view, LEAST / LARGEST_RATIO)
        missed = np.where(decided, 1.0, odds) / np.maximum(1.0 - found, LEAST)
        hidden = np.where(seen[:, None], 0.0, np.where(by_place < LEAST, 1.0, missed))
        inside = outside = None
        if self.detectable is not None and self.detectable_hidden is not None:
            inside = runs.next(runs.after(self.detectable[0], found, seen))
            outside = runs.next(self.detectable_hidden[0])
        return InViewRecord(
            hidden=np.minimum(hidden, LARGEST_RATIO),
            unoccluded=self.unoccluded[0],
            detectable=inside,
            detectable_hidden=outside,
        )


def _some(values: Array | None, rows: Any) -> Array | None:
    return None if values is None else np.asarray(values[rows])


def _with_rows(values: Array, rows: Index, others: Array | None) -> Array:
    changed = values.copy()
    changed[rows] = others
    return changed


def _joined(first: Array | None, second: Array | None) -> Array | None:
    return None if first is None or second is None else np.concatenate([first, second])


def _mixed(weight: Array, one: Array, other_weight: Array, other: Array, otherwise: Array) -> Array:
    """Mean of ``one`` and ``other`` by their weights; ``otherwise`` where both weights vanish."""
    total = weight + other_weight
    mean = (weight * one + other_weight * other) / np.maximum(total, LEAST)
    return np.where(total > LEAST, mean, otherwise)

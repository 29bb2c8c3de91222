"""Objects of a merged map: ids, names, classes, existence and descriptors from both maps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.maps.class_priors import class_evidence, known_priors
from semantic_slam.maps.saved_map import MapObjects, SavedMap, have_common_ancestor


@dataclass(frozen=True, kw_only=True)
class MergedRows:
    """Pairs of rows that are one object, and the rows of the stacked states kept in the merged map."""

    same: tuple[tuple[int, int], ...]
    displaced: tuple[tuple[int, int], ...]
    kept: Index  # (N,) the first map's objects at their current places, then those only in the second


def merged_objects(
    one: SavedMap, other: SavedMap, rows: MergedRows, states: Array, covariances: Array, existence: Array
) -> MapObjects:
    """Build N merged objects at coordinates ``states`` (N, 3) with ``covariances`` (N, 3, 3); ``existence`` (N,)."""
    count, first = len(one.objects), len(one.objects)
    partner, share = dict((*rows.same, *rows.displaced)), _share(one, other)
    later = [int(row) - first for row in rows.kept[count:].tolist()]
    sources = [(row, partner.get(row, -1)) for row in range(count)] + [(-1, row) for row in later]
    means, variances = zip(*(_descriptor(one.objects, other.objects, i, j, share) for i, j in sources), strict=True)
    priors, classes = _classes(one, other, sources)
    ids, names = _numbers(one.objects, other.objects, later)
    unknown = np.full(len(sources), np.nan)
    return MapObjects(
        ids=ids,
        names=names,
        poses=one.coordinates.poses(states),
        covariances=one.coordinates.pose_covariances(covariances),
        existence=existence,
        class_probabilities=classes,
        class_priors=priors,
        descriptors=np.array(means),
        descriptor_variances=np.array(variances),
        missing=unknown,
        moved=unknown,
        sightings=np.array([_sightings(one.objects, other.objects, i, j) for i, j in sources]),
    )


def _share(one: SavedMap, other: SavedMap) -> float:
    """Share of what each map knows of an object in both: half where both came from one map."""
    return 0.5 if have_common_ancestor(one, other) else 1.0


def _numbers(one: MapObjects, other: MapObjects, later: list[int]) -> tuple[Index, tuple[str, ...]]:
    """Ids and names; objects only in the second map keep theirs where these are free."""
    ids, names = one.ids.tolist(), list(one.names)
    following = 1 + max([*ids, *other.ids.tolist()], default=-1)
    for row in later:
        number, name = int(other.ids[row]), other.names[row]
        if number in ids:
            number, following = following, following + 1
        ids.append(number)
        names.append(str(number) if name in names else name)
    return np.array(ids, dtype=np.int64), tuple(names)


def _sightings(one: MapObjects, other: MapObjects, i: int, j: int) -> float:
    return float(sum(objects.sightings[row] for objects, row in ((one, i), (other, j)) if row >= 0))


def _classes(one: SavedMap, other: SavedMap, sources: Sequence[tuple[int, int]]) -> tuple[Array, Array]:
    """(N, C) class priors and probabilities; observations of an object in both maps are independent evidence.

    The priors of the two runs are not independent; the merged prior is their mean. Where both came from one map, its
    evidence is contained in both, so each counts half, as for positions.
    """
    size, share = len(one.class_names or other.class_names), _share(one, other)
    halves = np.where((np.array(sources).reshape(-1, 2) >= 0).all(axis=1), share, 1.0)[:, None]
    evidence, summed, count = np.ones((len(sources), size)), np.zeros((len(sources), size)), np.zeros((len(sources), 1))
    for known, rows in zip((one, other), np.array(sources).reshape(-1, 2).T, strict=True):
        if known.class_names:
            own = np.flatnonzero(rows >= 0)
            evidence[own] *= class_evidence(known.objects)[rows[own]] ** halves[own]
            summed[own] += known_priors(known.objects)[rows[own]]
            count[own] += 1.0
    priors = np.where(count > 0.0, summed / np.maximum(count, 1.0), 1.0 / max(size, 1))
    posterior = evidence * priors
    return priors, posterior / posterior.sum(axis=1, keepdims=True) if size else posterior


def _descriptor(one: MapObjects, other: MapObjects, i: int, j: int, share: float) -> tuple[Array, Array]:
    """(L,) information-weighted mean and variance of both descriptors; NaN where neither is known.

    Of one in both maps, each has the ``share`` of its information.
    """
    halved = share if min(i, j) >= 0 else 1.0
    size = max(one.descriptors.shape[1], other.descriptors.shape[1])
    information, summed = np.zeros(size), np.zeros(size)
    for objects, row in ((one, i), (other, j)):
        if row >= 0 and objects.descriptors.shape[1] == size and np.isfinite(objects.descriptors[row]).all():
            weight = halved / objects.descriptor_variances[row]
            information, summed = information + weight, summed + weight * objects.descriptors[row]
    known = information > 0.0
    variance = np.where(known, 1.0 / np.where(known, information, 1.0), np.nan)
    return summed * variance, variance

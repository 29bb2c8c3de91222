"""Association scores over clusters of objects so close together that merging them is acceptable."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from semantic_slam.evaluation.association import CLUTTER, PairScore, pair_score
from semantic_slam.geometry.arrays import Array, Index


def clusters_of(positions: Array, distance_m: float) -> Index:
    """(N,) cluster of each of (N, 2 or 3) positions [m], from 0: single linkage, cut at ``distance_m``."""
    if len(positions) < 2:
        return np.zeros(len(positions), dtype=int)
    return np.asarray(fcluster(linkage(positions, "single"), distance_m, "distance") - 1, dtype=int)


def majority(estimate: Sequence[int], reference: Sequence[int]) -> dict[int, int]:
    """Estimated id -> reference id of the majority of its detections, the smaller id on a tie.

    Both sequences have one id per detection; negative ids are clutter and have no vote. An estimated id without votes
    is left out.
    """
    votes: dict[int, Counter[int]] = {}
    for own, true in zip(estimate, reference, strict=True):
        if own > CLUTTER and true > CLUTTER:
            votes.setdefault(own, Counter())[true] += 1
    return {own: min(found, key=lambda n: (-found[n], n)) for own, found in votes.items()}


def cluster_score(estimate: Sequence[int], reference: Sequence[int]) -> PairScore:
    """Pairs of detections in one cluster, ``reference`` naming the true cluster of every detection.

    Every estimated object (``estimate``: its id per detection) counts as of the cluster that most of its detections
    belong to; one whose detections all belong to none is a cluster of its own.
    """
    cluster = majority(estimate, reference)
    beyond = 1 + max([*cluster.values(), *reference, CLUTTER])
    found = [CLUTTER if own < 0 else cluster.get(own, beyond + own) for own in estimate]
    return pair_score(found, reference)


def num_duplicates(cluster_of_object: Mapping[int, int], true_objects: Mapping[int, int]) -> int:
    """Objects beyond the true ones, added over the clusters; too few in one cluster do not make up for them.

    ``cluster_of_object``: cluster of every estimated object, ``true_objects``: number of true ones in each cluster.
    """
    counts = Counter(cluster_of_object.values())
    return sum(max(count - true_objects.get(cluster, 0), 0) for cluster, count in counts.items())

"""Frame alignment of two maps: in place, or from proposed object correspondences.

Every pair of objects with headings proposes an alignment; for point objects, two pairs at equal distance do. The
evidence over all objects decides; what remains ambiguous stays a mixture.
"""

from itertools import combinations

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.maps.correspondence import Correspondence, corresponding
from semantic_slam.maps.landmarks import Landmarks, turned
from semantic_slam.maps.likelihood import Alignment, pairs

HEADING_RAD = 0.35
"""Largest standard deviation [rad] at which an object's heading can propose the rotation between maps."""
MOST_ANCHORS, MOST_PROPOSALS, MOST_REFINED = 12, 3000, 15
APART_M, APART_RAD = 0.3, 0.1
"""Alignments closer than this count as one."""
UNLIKELY = 12.0
"""Log-likelihood gap [nats] to the best beyond which an alignment is dropped."""


def in_place(
    old: Landmarks, new: Landmarks, log_absent: Array, *, is_continued: bool
) -> list[tuple[float, Correspondence]]:
    """Alignment of maps in one frame, each off by its own initial pose error; ``is_continued``: new came from old."""
    covariance = old.frame + new.frame + 1e-6 * np.eye(3)
    start = Alignment(T_old_new=np.zeros(3), covariance=covariance, centre=old.centre)
    prior = np.asarray(np.linalg.inv(covariance))
    return [(1.0, corresponding(old, new, log_absent, start, prior, is_continued=is_continued))]


def aligned(old: Landmarks, new: Landmarks, log_absent: Array) -> list[tuple[float, Correspondence]]:
    """Alignments with their probabilities, most likely first; empty where no objects can correspond."""
    proposals = _proposals(old, new)
    scored = sorted(((_score(old, new, log_absent, own), n) for n, own in enumerate(proposals)), reverse=True)
    found: list[Correspondence] = []
    for _, number in scored[:MOST_REFINED]:
        own = corresponding(old, new, log_absent, proposals[number], np.zeros((3, 3)))
        if not any(_are_one(own, other) for other in found):
            found.append(own)
    found = sorted(found, key=lambda own: -own.log_evidence)
    if not found:
        return []
    kept = [own for own in found if own.log_evidence > found[0].log_evidence - UNLIKELY]
    weights = np.exp(np.array([own.log_evidence for own in kept]) - kept[0].log_evidence)
    return list(zip((weights / weights.sum()).tolist(), kept, strict=True))


def _score(old: Landmarks, new: Landmarks, log_absent: Array, alignment: Alignment) -> float:
    """Approximate log likelihood: each old object is matched to its most likely unmoved counterpart."""
    told = pairs(old, new, alignment, np.ones(len(old)))
    return float(np.maximum(told.log_same.max(axis=1) - log_absent, 0.0).sum())


def _proposals(old: Landmarks, new: Landmarks) -> list[Alignment]:
    if not len(old) or not len(new):
        return []
    has_heading = max(old.covariances[:, 2, 2].min(), new.covariances[:, 2, 2].min()) < HEADING_RAD**2
    return _of_single_pairs(old, new) if has_heading else _of_two_pairs(old, new)


def _of_single_pairs(old: Landmarks, new: Landmarks) -> list[Alignment]:
    surest = np.argsort(old.covariances[:, 2, 2], kind="stable")[:MOST_ANCHORS]
    found = []
    for i in surest.tolist():
        for j in range(len(new)):
            if old.covariances[i, 2, 2] + new.covariances[j, 2, 2] > 2.0 * HEADING_RAD**2:
                continue
            T = se2.compose(old.states[i], se2.inverse(new.states[j]))
            _, there = turned(new.states[j : j + 1], new.covariances[j : j + 1], T)
            found.append(Alignment(T_old_new=T, covariance=old.covariances[i] + there[0], centre=old.states[i, :2]))
    return found[:MOST_PROPOSALS]


def _of_two_pairs(old: Landmarks, new: Landmarks) -> list[Alignment]:
    spread = old.covariances[:, 0, 0] + old.covariances[:, 1, 1]
    surest = np.argsort(spread, kind="stable")[:MOST_ANCHORS].tolist()
    fits: list[tuple[float, Alignment]] = []
    for i, k in combinations(surest, 2):
        there = old.states[k, :2] - old.states[i, :2]
        reach = float(np.hypot(*there))
        for j in range(len(new)):
            off = new.states[:, :2] - new.states[j, :2]
            distance = np.hypot(off[:, 0], off[:, 1])
            sigma = np.sqrt(0.01 + spread[i] + spread[k] + np.trace(new.covariances[j, :2, :2]))
            for other in np.flatnonzero((np.abs(distance - reach) < 3.0 * sigma) & (distance > 0.3)).tolist():
                if other != j and reach > 0.3:
                    fits.append((abs(distance[other] - reach) / sigma, _of_two(old, new, (i, k), (j, other))))
    fits.sort(key=lambda fit: fit[0])
    return [own for _, own in fits[:MOST_PROPOSALS]]


def _of_two(old: Landmarks, new: Landmarks, ours: tuple[int, int], theirs: tuple[int, int]) -> Alignment:
    (i, k), (j, other) = ours, theirs
    there, here = old.states[k, :2] - old.states[i, :2], new.states[other, :2] - new.states[j, :2]
    turn = float(np.arctan2(there[1], there[0]) - np.arctan2(here[1], here[0]))
    cos, sin = np.cos(turn), np.sin(turn)
    shift = old.states[i, :2] - np.array([[cos, -sin], [sin, cos]]) @ new.states[j, :2]
    place = old.covariances[i, :2, :2] + np.trace(new.covariances[j, :2, :2]) * np.eye(2)
    covariance = np.zeros((3, 3))
    covariance[:2, :2], covariance[2, 2] = place, 2.0 * np.trace(place) / float(there @ there)
    return Alignment(T_old_new=np.append(shift, turn), covariance=covariance, centre=old.states[i, :2])


def _are_one(one: Correspondence, other: Correspondence) -> bool:
    off = se2.between(one.alignment.T_old_new, other.alignment.T_old_new)
    return bool(np.hypot(off[0], off[1]) < APART_M and abs(off[2]) < APART_RAD)

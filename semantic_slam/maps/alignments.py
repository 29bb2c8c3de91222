"""Frame alignment of two maps: in place, or from proposed object correspondences.

Every pair of objects with headings proposes an alignment; for point objects, two pairs at equal distance do. The
evidence over all objects decides; what remains ambiguous stays a mixture.
"""

from itertools import combinations

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.maps.correspondence import Correspondence, corresponding
from semantic_slam.maps.frames import MapFrames
from semantic_slam.maps.landmarks import Landmarks
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
    size = old.frames.size
    covariance = old.frame + new.frame + 1e-6 * np.eye(size)
    start = Alignment(T_old_new=np.zeros(size), covariance=covariance, centre=old.centre)
    prior = np.asarray(np.linalg.inv(covariance))
    return [(1.0, corresponding(old, new, log_absent, start, prior, is_continued=is_continued))]


def aligned(old: Landmarks, new: Landmarks, log_absent: Array) -> list[tuple[float, Correspondence]]:
    """Alignments with their probabilities, most likely first; empty where no objects can correspond."""
    proposals = _proposals(old, new)
    scored = sorted(((_score(old, new, log_absent, own), n) for n, own in enumerate(proposals)), reverse=True)
    found: list[Correspondence] = []
    for _, number in scored[:MOST_REFINED]:
        own = corresponding(old, new, log_absent, proposals[number], np.zeros((old.frames.size,) * 2))
        if not any(_are_one(old.frames, own, other) for other in found):
            found.append(own)
    found = sorted(found, key=lambda own: -own.log_evidence)
    if not found:
        return []
    kept = [own for own in found if own.log_evidence > found[0].log_evidence - UNLIKELY]
    weights = np.exp(np.array([own.log_evidence for own in kept]) - kept[0].log_evidence)
    return list(zip((weights / weights.sum()).tolist(), kept, strict=True))


def _score(old: Landmarks, new: Landmarks, log_absent: Array, alignment: Alignment) -> float:
    """Approximate log likelihood: each old object is matched to its most likely unmoved counterpart."""
    likelihoods = pairs(old, new, alignment, np.ones(len(old)))
    return float(np.maximum(likelihoods.log_same.max(axis=1) - log_absent, 0.0).sum())


def _proposals(old: Landmarks, new: Landmarks) -> list[Alignment]:
    if not len(old) or not len(new):
        return []
    if old.frames.coordinates.has_yaw:
        least_variances = old.covariances[:, 2, 2].min(), new.covariances[:, 2, 2].min()
        if max(least_variances) < HEADING_RAD**2:
            return _of_single_pairs(old, new)
    return _of_two_pairs(old, new)


def _of_single_pairs(old: Landmarks, new: Landmarks) -> list[Alignment]:
    surest = np.argsort(old.covariances[:, 2, 2], kind="stable")[:MOST_ANCHORS]
    found = []
    for i in surest.tolist():
        for j in range(len(new)):
            if old.covariances[i, 2, 2] + new.covariances[j, 2, 2] > 2.0 * HEADING_RAD**2:
                continue
            T = se2.compose(old.states[i], se2.inverse(new.states[j]))
            turn = new.frames.turn(T)
            there = turn @ new.covariances[j] @ turn.T
            found.append(Alignment(T_old_new=T, covariance=old.covariances[i] + there, centre=old.states[i, :2]))
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
    frames, axes = old.frames, slice(0, old.frames.num_axes)
    by_turn = frames.turn(np.append(np.zeros(frames.num_axes), turn))[axes, axes]
    shift = old.states[i, axes] - by_turn @ new.states[j, axes]
    place = old.covariances[i, axes, axes] + np.trace(new.covariances[j, :2, :2]) * np.eye(frames.num_axes)
    covariance = np.zeros((frames.size, frames.size))
    covariance[axes, axes] = place
    covariance[-1, -1] = 2.0 * np.trace(place[:2, :2]) / float(there @ there)
    return Alignment(T_old_new=np.append(shift, turn), covariance=covariance, centre=old.states[i, :2])


def _are_one(frames: MapFrames, one: Correspondence, other: Correspondence) -> bool:
    off = frames.compose(frames.inverse(one.alignment.T_old_new), other.alignment.T_old_new)
    return bool(np.linalg.norm(off[:-1]) < APART_M and abs(off[-1]) < APART_RAD)

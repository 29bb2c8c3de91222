"""Frame alignment of two maps: in place, or from proposed object correspondences.

Every pair of objects with headings proposes an alignment; for point objects, two pairs at equal distance do. The
evidence over all objects decides between them, and whether the maps are of one place at all; what remains ambiguous
stays a mixture.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import expit, logit

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.maps.common_place import log_odds_of_one_place
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
ONE_PLACE_SHARE = 0.1
"""Prior probability that two maps of unknown alignment have a place in common: a wrong merge cannot be taken back."""


@dataclass(frozen=True, kw_only=True)
class Alignments:
    """Ways in which two maps may be of one place."""

    one_place: float  # probability that they are of one place, and lie in one of these ways
    of_one_place: tuple[tuple[float, Correspondence], ...]  # with their probabilities given that, most likely first


def in_place(old: Landmarks, new: Landmarks, log_absent: Array, *, is_continued: bool) -> Alignments:
    """Alignment of maps in one frame, each off by its own initial pose error; ``is_continued``: new came from old."""
    size = old.frames.size
    covariance = old.frame + new.frame + 1e-6 * np.eye(size)
    start = Alignment(T_old_new=np.zeros(size), covariance=covariance, centre=old.centre)
    prior = np.asarray(np.linalg.inv(covariance))
    own = corresponding(old, new, log_absent, start, prior, is_continued=is_continued)
    return Alignments(one_place=1.0, of_one_place=((1.0, own),))


def aligned(old: Landmarks, new: Landmarks, log_absent: Array) -> Alignments:
    """Alignments by the objects in common; none where no objects can correspond."""
    proposals = _proposals(old, new)
    scored = sorted(((_score(old, new, log_absent, own), n) for n, own in enumerate(proposals)), reverse=True)
    found: list[Correspondence] = []
    for _, number in scored[:MOST_REFINED]:
        own = corresponding(old, new, log_absent, proposals[number], np.zeros((old.frames.size,) * 2))
        if not any(_are_one(old.frames, own, other) for other in found):
            found.append(own)
    return _weighed([(log_odds_of_one_place(old, new, log_absent, own), own) for own in found])


def _weighed(found: list[tuple[float, Correspondence]]) -> Alignments:
    """Probabilities of alignments from their log odds against different places."""
    if not found:
        return Alignments(one_place=0.0, of_one_place=())
    found = sorted(found, key=lambda own: -own[0])
    log_odds = np.array([log_odds for log_odds, _ in found if log_odds > found[0][0] - UNLIKELY])
    log_sum = float(np.logaddexp.reduce(log_odds))
    weights = np.exp(log_odds - log_sum).tolist()
    kept = tuple((weight, own) for weight, (_, own) in zip(weights, found, strict=False))
    return Alignments(one_place=float(expit(log_sum + logit(ONE_PLACE_SHARE))), of_one_place=kept)


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

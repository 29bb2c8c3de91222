"""Likelihood that objects of two maps are the same one, unmoved or displaced; natural logs throughout."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.maps.landmarks import Landmarks, turned

DISPLACED_SHARE, GONE_SHARE = 0.05, 0.05
"""Prior shares of objects displaced, and gone, by the next session; as many are new as are gone."""
DISPLACED_M = (0.3, 1.0, 3.0)
"""Standard deviations [m] per axis of a displacement, an even mixture: from nudged to carried."""
REPLACED_SHARE, REPLACED_M = 0.5, 0.3
"""Share of vacated places taken by an object of another class, and its per-axis standard deviation [m]."""
FLOOR_M, FLOOR_RAD = 0.03, 0.03
"""Standard deviations of unmodelled map errors, such as the apparent centre of an object."""
OTHER_HEADING = 0.02
"""Share of uninformative headings: the object was rotated in place, or misread."""
SURROUNDINGS_M = 2.0
"""Margin [m] around a map's objects in which new ones are expected."""


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """Pose of the new map's frame in the old map's frame."""

    T_old_new: Array  # (F,) as :mod:`frames` has it
    covariance: Array  # (F, F) of a shift, and a rotation about ``centre``
    centre: Array  # (2,) in the old frame


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Pair likelihoods of n old with m new objects."""

    log_same: Array  # same unmoved object, relative to "old one gone and a new one"
    log_displaced: Array
    offset: Array  # (n, m, 3) from where it was to where it is, the coordinates [m, rad] of the old frame
    covariance: Array  # (n, m, 3, 3) of the offset
    log_unmatched: Array  # (m,) log density of new objects at the new ones' places


def pairs(old: Landmarks, new: Landmarks, alignment: Alignment, vacated: Array, *, is_continued: bool = False) -> Pairs:
    """Likelihoods of all pairs under an alignment; ``vacated`` (n,): probabilities that old objects left.

    ``is_continued``: the new map inherited object positions from the old one, so a matching position is no evidence:
    only the class separates the same object from another one in its place.
    """
    frames, at = old.frames, slice(0, old.frames.num_axes)
    states, covariances = turned(new, alignment.T_old_new)
    offset = frames.coordinates.difference(states[None], old.states[:, None])
    slopes = frames.slopes(states, alignment.centre)
    spread = covariances + slopes @ alignment.covariance @ np.swapaxes(slopes, 1, 2)
    floor = np.diag(frames.coordinate_sigmas(FLOOR_M, FLOOR_RAD)) ** 2
    total = old.covariances[:, None] + spread[None] + floor
    alike = _log_classes(old, new) + _log_descriptors(old, new)
    stays = np.log(1.0 - DISPLACED_SHARE - GONE_SHARE) + np.log(old.existence)[:, None]
    moves = np.log(DISPLACED_SHARE) + np.log(old.existence)[:, None]
    away, spread_away = offset[..., at], total[..., at, at]
    in_place = _log_normal(away, spread_away)
    if frames.coordinates.has_yaw:
        in_place = in_place + _log_heading(offset, total)
    instead = _log_normal(away, spread_away + REPLACED_M**2 * np.eye(frames.num_axes))
    if is_continued:
        instead = np.where(old.ids[:, None] == new.ids, np.maximum(instead, in_place), instead)
    replacing = REPLACED_SHARE * vacated @ np.exp(instead + _log_other_class(old, new))
    log_unmatched = np.log(np.exp(log_new_density(old)) + replacing)
    there = np.log(new.existence) - log_unmatched
    return Pairs(
        log_same=stays + there + alike + in_place,
        log_displaced=moves + there + alike + _log_moved(away, spread_away),
        offset=offset,
        covariance=total,
        log_unmatched=log_unmatched,
    )


def log_new_density(old: Landmarks) -> float:
    """Log density of new objects per square metre, in space per cubic metre; as many appear as disappear."""
    low, high = surroundings(old)
    return float(np.log(GONE_SHARE * max(old.existence.sum(), 1.0) / np.prod(high - low)))


def surroundings(known: Landmarks) -> tuple[Array, Array]:
    """Least and largest coordinates (2,) [m] of the box in which a map is expected to hold objects; (3,) in space."""
    places = known.states[:, : known.frames.num_axes]
    return places.min(axis=0) - SURROUNDINGS_M, places.max(axis=0) + SURROUNDINGS_M


def _log_normal(offset: Array, covariance: Array) -> Array:
    squared = (offset * np.linalg.solve(covariance, offset[..., None])[..., 0]).sum(axis=-1)
    return np.asarray(-0.5 * squared - 0.5 * np.linalg.slogdet(2.0 * np.pi * covariance)[1])


def _log_moved(offset: Array, covariance: Array) -> Array:
    log_densities = [_log_normal(offset, covariance + sigma**2 * np.eye(offset.shape[-1])) for sigma in DISPLACED_M]
    return np.asarray(np.logaddexp.reduce(log_densities) - np.log(len(DISPLACED_M)))


def _log_heading(offset: Array, covariance: Array) -> Array:
    """Log likelihood ratio of headings to an unknown heading; 0 for objects without one."""
    variance = covariance[..., 2, 2]
    density = np.exp(-0.5 * offset[..., 2] ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
    ratio = np.where(variance < 1.0, 2.0 * np.pi * density, 1.0)
    return np.asarray(np.log((1.0 - OTHER_HEADING) * ratio + OTHER_HEADING))


def _log_classes(old: Landmarks, new: Landmarks) -> Array:
    """Log ratio that two objects have the same class, relative to random ones: log sum_c p(c) q(c) C."""
    count = old.classes.shape[1]
    if not count:
        return np.zeros((len(old), len(new)))
    return np.asarray(np.log(count * old.classes @ new.classes.T))


def _log_other_class(old: Landmarks, new: Landmarks) -> Array:
    """Log ratio that two objects have different classes, relative to random ones; -inf without classes."""
    count = old.classes.shape[1]
    if count < 2:
        return np.full((len(old), len(new)), -np.inf)
    return np.asarray(np.log((1.0 - old.classes @ new.classes.T) * count / (count - 1)))


def _log_descriptors(old: Landmarks, new: Landmarks) -> Array:
    """Log ratio that two objects share one descriptor, relative to random ones; 0 where one is unknown."""
    unknown = np.zeros((len(old), len(new)))
    if not old.descriptors.shape[1] or old.descriptors.shape[1] != new.descriptors.shape[1] or len(new) < 2:
        return unknown
    ours, theirs = (np.asarray(np.isfinite(own.descriptors).all(axis=1)) for own in (old, new))
    broad = np.nanvar(np.concatenate([old.descriptors, new.descriptors]), axis=0)
    variance = old.descriptor_variances[:, None] + new.descriptor_variances[None]
    off = (old.descriptors[:, None] - new.descriptors[None]) ** 2
    any_two = variance + 2.0 * broad
    ratio = -0.5 * (off / variance - off / any_two + np.log(variance / any_two)).sum(axis=-1)
    return np.where(ours[:, None] & theirs, np.nan_to_num(ratio), unknown)

"""How likely two objects of two maps are the same one, where it stood or elsewhere; natural logs throughout."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.maps.landmarks import Landmarks, frame_slopes, turned

DISPLACED_SHARE, GONE_SHARE = 0.05, 0.05
"""How many objects of a map stand elsewhere by the next session, and how many are gone; as many are new."""
DISPLACED_M = (0.3, 1.0, 3.0)
"""Standard deviations along x and y of how far something was moved, of which any may be right: nudged, or carried."""
REPLACED_SHARE, REPLACED_M = 0.5, 0.3
"""In how many places that were left something of another class stands, and how far from there along x and y."""
FLOOR_M, FLOOR_RAD = 0.03, 0.03
"""Standard deviations of what maps do not say of themselves: where the middle of an object seems to be."""
OTHER_HEADING = 0.02
"""Share of headings that tell nothing, since the object was turned on the spot or misread."""
SURROUNDINGS_M = 2.0
"""How far about the objects of a map new ones are looked for."""


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """Where the new map's frame is in the old one's."""

    T_old_new: Array  # (3,)
    covariance: Array  # (3, 3) of a shift, and a turn about ``centre``
    centre: Array  # (2,) in the old frame


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """(n, m) old objects with new ones."""

    log_same: Array  # that it is the same one, where it stood, relative to an old one that is gone and a new one
    log_displaced: Array
    offset: Array  # (n, m, 3) from where it was to where it is, x, y [m] and yaw [rad] in the old frame
    covariance: Array  # (n, m, 3, 3) of the offset


def pairs(old: Landmarks, new: Landmarks, alignment: Alignment, vacated: Array, *, is_continued: bool = False) -> Pairs:
    """All pairs under an alignment; ``vacated`` (n,): probabilities that old objects are not where they were.

    ``is_continued``: the new map has the places of the old one's objects from that, so that what it takes for one of
    them stands there for that reason, too: class alone tells it from something else in its place.
    """
    states, covariances = turned(new.states, new.covariances, alignment.T_old_new)
    offset = states[None] - old.states[:, None]
    offset[..., 2] = wrap_angle(offset[..., 2])
    slopes = frame_slopes(states, alignment.centre)
    spread = covariances + slopes @ alignment.covariance @ np.swapaxes(slopes, 1, 2)
    floor = np.diag([FLOOR_M, FLOOR_M, FLOOR_RAD]) ** 2
    total = old.covariances[:, None] + spread[None] + floor
    alike = _log_classes(old, new) + _log_descriptors(old, new)
    stays = np.log(1.0 - DISPLACED_SHARE - GONE_SHARE) + np.log(old.existence)[:, None]
    moves = np.log(DISPLACED_SHARE) + np.log(old.existence)[:, None]
    in_place = _log_normal(offset[..., :2], total[..., :2, :2]) + _log_heading(offset, total)
    instead = _log_normal(offset[..., :2], total[..., :2, :2] + REPLACED_M**2 * np.eye(2))
    if is_continued:
        instead = np.where(old.ids[:, None] == new.ids, np.maximum(instead, in_place), instead)
    replacing = REPLACED_SHARE * vacated @ np.exp(instead + _log_other_class(old, new))
    there = np.log(new.existence) - np.log(np.exp(log_new_density(old)) + replacing)
    return Pairs(
        log_same=stays + there + alike + in_place,
        log_displaced=moves + there + alike + _log_moved(offset[..., :2], total[..., :2, :2]),
        offset=offset,
        covariance=total,
    )


def log_new_density(old: Landmarks) -> float:
    """Log of new objects per square metre anywhere: as many come as go."""
    low, high = old.states[:, :2].min(axis=0) - SURROUNDINGS_M, old.states[:, :2].max(axis=0) + SURROUNDINGS_M
    return float(np.log(GONE_SHARE * max(old.existence.sum(), 1.0) / np.prod(high - low)))


def _log_normal(offset: Array, covariance: Array) -> Array:
    squared = (offset * np.linalg.solve(covariance, offset[..., None])[..., 0]).sum(axis=-1)
    return np.asarray(-0.5 * squared - 0.5 * np.linalg.slogdet(2.0 * np.pi * covariance)[1])


def _log_moved(offset: Array, covariance: Array) -> Array:
    told = [_log_normal(offset, covariance + sigma**2 * np.eye(2)) for sigma in DISPLACED_M]
    return np.asarray(np.logaddexp.reduce(told) - np.log(len(DISPLACED_M)))


def _log_heading(offset: Array, covariance: Array) -> Array:
    """Relative to a heading of which nothing is known; that of an object that has none tells nothing either."""
    variance = covariance[..., 2, 2]
    density = np.exp(-0.5 * offset[..., 2] ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
    told = np.where(variance < 1.0, 2.0 * np.pi * density, 1.0)
    return np.asarray(np.log((1.0 - OTHER_HEADING) * told + OTHER_HEADING))


def _log_classes(old: Landmarks, new: Landmarks) -> Array:
    """That two objects are of one class, relative to any two: log sum_c p(c) q(c) C."""
    count = old.classes.shape[1]
    if not count:
        return np.zeros((len(old), len(new)))
    return np.asarray(np.log(count * old.classes @ new.classes.T))


def _log_other_class(old: Landmarks, new: Landmarks) -> Array:
    """That two objects are of two classes, relative to any two; -inf where no classes are known."""
    count = old.classes.shape[1]
    if count < 2:
        return np.full((len(old), len(new)), -np.inf)
    return np.asarray(np.log((1.0 - old.classes @ new.classes.T) * count / (count - 1)))


def _log_descriptors(old: Landmarks, new: Landmarks) -> Array:
    """That two objects have one descriptor, relative to any two; 0 where one is not known."""
    told = np.zeros((len(old), len(new)))
    if not old.descriptors.shape[1] or old.descriptors.shape[1] != new.descriptors.shape[1] or len(new) < 2:
        return told
    ours, theirs = (np.asarray(np.isfinite(own.descriptors).all(axis=1)) for own in (old, new))
    broad = np.nanvar(np.concatenate([old.descriptors, new.descriptors]), axis=0)
    variance = old.descriptor_variances[:, None] + new.descriptor_variances[None]
    off = (old.descriptors[:, None] - new.descriptors[None]) ** 2
    any_two = variance + 2.0 * broad
    ratio = -0.5 * (off / variance - off / any_two + np.log(variance / any_two)).sum(axis=-1)
    return np.where(ours[:, None] & theirs, np.nan_to_num(ratio), told)

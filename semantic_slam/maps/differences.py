"""What changed between two maps: each object the same, displaced, gone or new, with its probability."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.maps.alignments import aligned, in_place
from semantic_slam.maps.correspondence import Correspondence
from semantic_slam.maps.landmarks import Landmarks, compared_rows
from semantic_slam.maps.likelihood import DISPLACED_SHARE, GONE_SHARE
from semantic_slam.maps.saved_map import SavedMap

SEEN_IN_A_LOOK = 0.3
"""Probability that an object in the sensor's region is detected, whatever may hide it."""
LEAST_UNSEEN = 1e-3
"""That an object is never detected however often one looks: it may be hidden for good."""
KINDS = ("same", "displaced", "gone", "unseen", "none")


@dataclass(frozen=True, kw_only=True)
class OldObject:
    """What became of an object of the old map."""

    object_id: int
    name: str
    probabilities: dict[str, float]  # of KINDS; none: there never was one
    new_id: int | None  # under which the new map has it, if it has
    distance_m: float  # from where it was, in the likeliest case; NaN without a counterpart
    sigma_m: float  # standard deviation of that

    @property
    def kind(self) -> str:
        """The likeliest of KINDS."""
        return max(KINDS, key=lambda kind: self.probabilities[kind])


@dataclass(frozen=True, kw_only=True)
class NewObject:
    """An object of the new map, and how probably it exists and the old one has it nowhere."""

    object_id: int
    name: str
    probability: float
    position: Array  # (2,) in the old map's frame


@dataclass(frozen=True, kw_only=True)
class MapDifference:
    """Of all objects that exist with some probability."""

    old: tuple[OldObject, ...]
    new: tuple[NewObject, ...]
    T_old_new: Array  # (3,) x, y, yaw of the new map's frame in the old one's
    same_frame: bool  # else aligned by which objects are the same
    alignment_probability: float


def difference(old: SavedMap, new: SavedMap, same_frame: bool | None = None) -> MapDifference:
    """``same_frame`` None: where one map came from the other, or both from one. Raises InputError."""
    if same_frame is None:
        same_frame = are_of_one_frame(old, new)
    found, ours, theirs = correspondences(old, new, same_frame)
    shares = np.array([weight for weight, _ in found])
    same = sum(weight * own.same for weight, own in found)
    displaced = sum(weight * own.displaced for weight, own in found)
    best = found[0][1]
    log_there = np.array([own for own in _unmatched_stays(old, new, ours.rows, best)])
    positions = se2.compose(np.broadcast_to(best.alignment.T_old_new, theirs.states.shape), theirs.states)[:, :2]
    apart = np.clip(1.0 - (same + displaced).sum(axis=0), 0.0, 1.0)
    return MapDifference(
        old=tuple(
            _old_object(old, new, ours, theirs, best, row, same[row], displaced[row], log_there[row])
            for row in range(len(ours))
        ),
        new=tuple(
            NewObject(
                object_id=int(new.objects.ids[row]),
                name=new.objects.names[row],
                probability=float(apart[column] * theirs.existence[column]),
                position=positions[column],
            )
            for column, row in enumerate(theirs.rows.tolist())
        ),
        T_old_new=best.alignment.T_old_new,
        same_frame=same_frame,
        alignment_probability=float(shares[0]),
    )


def correspondences(
    old: SavedMap, new: SavedMap, same_frame: bool
) -> tuple[list[tuple[float, Correspondence]], Landmarks, Landmarks]:
    """Alignments with their probabilities, and the objects that are compared. Raises InputError."""
    names = [name for name in old.class_names if name in new.class_names]
    rows = compared_rows(new)
    if new.provenance.started_from == old.map_id:
        rows = rows[~_only_told(old, new, rows)]
    ours, theirs = Landmarks.of(old, names, compared_rows(old)), Landmarks.of(new, names, rows)
    if not len(ours) or not len(theirs):
        raise InputError("one of the maps has no object that is known to exist; compare maps with objects")
    # Roughly until the alignment is known: whether the place was looked at hardly changes it.
    log_absent = np.log(1.0 - ours.existence + ours.existence * (GONE_SHARE + LEAST_UNSEEN))
    found = (in_place if same_frame else aligned)(ours, theirs, log_absent)
    if not found:
        raise InputError("the maps cannot be aligned: no object of one may be one of the other")
    return found, ours, theirs


def are_of_one_frame(old: SavedMap, new: SavedMap) -> bool:
    """Whether provenance says that the frame of both is one."""
    one, other = old.provenance.started_from, new.provenance.started_from
    return other == old.map_id or one == new.map_id or bool(one and one == other)


def _only_told(old: SavedMap, new: SavedMap, rows: Index) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
    """Which objects of a map that came from the old one are there for the old one's word alone."""
    return np.isin(new.objects.ids[rows], old.objects.ids) & (new.objects.sightings[rows] == 0.0)


def _unmatched_stays(old: SavedMap, new: SavedMap, rows: Index, best: Correspondence) -> Array:
    """(n,) that an old object without a counterpart stands where it stood, unseen, relative to that it is gone."""
    inverse = se2.inverse(best.alignment.T_old_new)
    states = planar_from_pose_vector(old.objects.poses[rows])
    places = se2.compose(np.broadcast_to(inverse, states.shape), states)[:, :2]
    if len(new.looks.path):
        counts = new.looks.counts(places)
        unseen = np.maximum((1.0 - SEEN_IN_A_LOOK) ** counts, LEAST_UNSEEN)
    else:
        unseen = np.ones(len(rows))
    stays = (1.0 - GONE_SHARE - DISPLACED_SHARE) * unseen
    return np.asarray(stays / (stays + GONE_SHARE))


def _old_object(
    old: SavedMap,
    new: SavedMap,
    ours: Landmarks,
    theirs: Landmarks,
    best: Correspondence,
    row: int,
    same: Array,
    displaced: Array,
    stays: float,
) -> OldObject:
    left = max(1.0 - float(same.sum() + displaced.sum()), 0.0)
    exists = float(ours.existence[row])
    there = exists * (GONE_SHARE / max(1.0 - stays, 1e-12))
    absent = left * (1.0 - exists) / (1.0 - exists + there)
    probabilities = {
        "same": float(same.sum()),
        "displaced": float(displaced.sum()),
        "gone": (left - absent) * (1.0 - stays),
        "unseen": (left - absent) * stays,
        "none": absent,
    }
    column = int(np.argmax(same + displaced))
    known = bool(same[column] + displaced[column] > left)
    offset, spread = best.pairs.offset[row, column, :2], best.pairs.covariance[row, column, :2, :2]
    distance = float(np.hypot(*offset))
    along = offset / max(distance, 1e-9)
    number = int(ours.rows[row])
    return OldObject(
        object_id=int(old.objects.ids[number]),
        name=old.objects.names[number],
        probabilities=probabilities,
        new_id=int(new.objects.ids[theirs.rows[column]]) if known else None,
        distance_m=distance if known else float("nan"),
        sigma_m=float(np.sqrt(along @ spread @ along)) if known else float("nan"),
    )

"""Looks of a run at its known objects: range, direction, whether in view, and whether detected.

Taken from the final hypotheses, by their weights. Looks at an object count from the keyframe after its first detection
on: the first detection creates the object and says nothing of the detection rate.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.history import histories, lineage
from semantic_slam.evaluation.record import Record
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.open_world.planar.region import SensorRegion, region_of
from semantic_slam.inference.states.direction_shares import even_directions
from semantic_slam.training.sightings import existence_if_detected

LEAST_WEIGHT = 0.01
"""Smallest weight of a hypothesis that is used."""
LEAST_EXISTENCE = 0.5
"""Smallest existence probability of an object that is used."""
NUM_DIRECTIONS = 7
"""Number of directions, from the right to the left edge of the field of view, with their own detection probability."""
LEAST_SHARE = 1e-3
"""Lower bound of the in-view probability of a detected object: where it seems out of view, its position was wrong."""


@dataclass(frozen=True, kw_only=True)
class Looks:
    """Looks in K keyframes of one run at O objects; an object is listed once per distinct detection history."""

    weights: Array  # (O,) probability of existence with this detection history
    is_known: Flags  # (K, O) known since an earlier keyframe
    is_detected: Flags  # (K, O)
    in_view: Array  # (K, O) probability of being inside the region and unoccluded
    ranges_m: Array  # (K, O)
    off_centre_rad: Array  # (K, O) bearings relative to the centre of the region
    field_of_view_rad: float  # of the region

    @property
    def num_in_view(self) -> int:
        """Looks at objects that are known and probably in view."""
        return round(float((self.is_known & (self.in_view > 0.5)).sum(axis=0) @ self.weights))

    @cached_property
    def hats(self) -> Array:
        """(K, O, NUM_DIRECTIONS) linear interpolation weights of each look over the directions; they sum to 1."""
        nodes = even_directions(NUM_DIRECTIONS, self.field_of_view_rad)
        return np.stack([np.interp(self.off_centre_rad, nodes, own) for own in np.eye(NUM_DIRECTIONS)], axis=-1)


def looks_of(record: Record, settings: Configuration) -> Looks | None:
    """Looks of the final hypotheses; None where misses do not count. A region that was learned is that at the end.

    None, too, for a run in space: what is in view here is that of a robot in the plane.
    """
    beliefs = record.beliefs
    if not strategy_of(settings).counts_misses or settings.is_spatial:
        return None
    last = beliefs[-1]
    region = region_of(settings.open_world, last.noise)
    kept = (last.existence >= LEAST_EXISTENCE) & np.isfinite(last.object_poses).all(axis=1)
    ids, existence = last.object_ids[kept].astype(int), last.existence[kept]
    if not len(ids):
        return None
    columns, weights, detected = _distinct(beliefs, ids)
    if not len(columns):
        return None
    by_object = np.asarray(np.bincount(columns, weights, minlength=len(ids)), dtype=np.float64)
    exists = existence_if_detected(existence, by_object)
    seen = [np.array(own)[:, columns] for own in zip(*_seen(record, region, ids), strict=True)]
    in_view, ranges, off_centre = seen
    is_known = np.zeros_like(detected)
    is_known[1:] = np.logical_or.accumulate(detected, axis=0)[:-1]
    return Looks(
        weights=weights * exists[columns],
        is_known=is_known,
        is_detected=detected,
        in_view=np.where(detected, np.maximum(in_view, LEAST_SHARE), in_view),
        ranges_m=ranges,
        off_centre_rad=off_centre,
        field_of_view_rad=region.field_of_view_rad,
    )


def _distinct(beliefs: Sequence[HybridBelief], ids: Index) -> tuple[Index, Array, Flags]:
    """(R,) which of the objects was detected in which keyframes (K, R), by hypotheses that weigh so much (R,).

    Histories without a detection are left out: nothing is known of the object before its first one.
    """
    hypotheses = np.exp(beliefs[-1].log_weights)
    likely = np.flatnonzero(hypotheses >= LEAST_WEIGHT)
    found, weights = histories(beliefs), dict[tuple[int, bytes], float]()
    for row in likely.tolist():
        detected = _detected(found, row, ids)
        for column in np.flatnonzero(detected.any(axis=0)).tolist():
            what = column, detected[:, column].tobytes()
            weights[what] = weights.get(what, 0.0) + float(hypotheses[row])
    columns = np.array([column for column, _ in weights], dtype=int)
    flags = np.array([np.frombuffer(own, dtype=bool) for _, own in weights]).reshape(len(columns), len(beliefs))
    return columns, np.array(list(weights.values())) / hypotheses[likely].sum(), flags.T


def _detected(found: list[Index], row: int, ids: Index) -> Flags:
    """(K, O)"""
    return np.array([np.isin(ids, own[row]) for own in found])


def _seen(record: Record, region: SensorRegion, ids: Index) -> Iterator[tuple[Array, Array, Array]]:
    """For each keyframe (O,) probabilities that objects are in view, ranges and bearings, by what was believed then."""
    beliefs, ancestors = record.beliefs, lineage(record.beliefs)
    for belief, ancestor in zip(beliefs, ancestors, strict=True):
        robot = planar_from_pose_vector(belief.poses[max(ancestor, 0)])
        places, covariances = _places(belief, beliefs[-1], ids)
        relative = _in_body(robot, places)
        turned = _turned(robot[2], covariances)
        measured = record.measurements[belief.stamp_ns]
        inside = region.contains(relative, turned)
        clear = region.not_occluded(relative, measured.ranges_m, measured.bearings_rad, measured.free_range_scan)
        bearings = np.arctan2(relative[:, 1], relative[:, 0])
        yield inside * clear, np.hypot(relative[:, 0], relative[:, 1]), region.off_centre(bearings)


def _places(belief: HybridBelief, last: HybridBelief, ids: Index) -> tuple[Array, Array]:
    """(O, 2) places and (O, 2, 2) covariances in map, of the keyframe's belief where it has the object."""
    found = [_place(belief, number) or _place(last, number) for number in ids.tolist()]
    places, covariances = zip(*[own for own in found if own is not None], strict=True)
    return np.array(places), np.array(covariances)


def _place(belief: HybridBelief, number: int) -> tuple[Array, Array] | None:
    """(2,) and (2, 2), None where the belief does not say where the object is."""
    rows = np.flatnonzero(belief.object_ids == number)
    if not len(rows) or not np.isfinite(belief.object_poses[rows[0]]).all():
        return None
    covariance = np.asarray(belief.object_covariances[rows[0]]).reshape(6, 6)[:2, :2]
    return belief.object_poses[rows[0], :2], covariance


def _in_body(robot: Array, places: Array) -> Array:
    """(O, 2) positions in the body frame of a robot (3,)."""
    sin, cos = np.sin(robot[2]), np.cos(robot[2])
    return np.asarray((places - robot[:2]) @ np.array([[cos, -sin], [sin, cos]]))


def _turned(heading: float, covariances: Array) -> Array:
    """(O, 2, 2) in the body frame."""
    sin, cos = np.sin(heading), np.cos(heading)
    turn = np.array([[cos, sin], [-sin, cos]])
    return np.asarray(turn @ covariances @ turn.T)

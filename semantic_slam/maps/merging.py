"""Merging of two maps: corresponding objects are fused using the joint Gaussians of both maps.

Maps that came from one map or recording, at whatever remove, both contain its information. Their covariances are
therefore doubled (covariance intersection with equal weights, Julier and Uhlmann, 1997), which is never overconfident
whatever is shared.
"""

import json
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.maps.as_prior import independent, joint_covariance
from semantic_slam.maps.common_classes import over_common_classes
from semantic_slam.maps.comparison import SURE, Comparison
from semantic_slam.maps.frames import MapFrames
from semantic_slam.maps.likelihood import FLOOR_M, FLOOR_RAD
from semantic_slam.maps.merged_existence import merged_existence
from semantic_slam.maps.merged_objects import MergedRows, merged_objects
from semantic_slam.maps.saved_map import (
    Provenance,
    SavedMap,
    ViewedFrom,
    are_of_one_recording,
    are_of_one_run,
    have_common_ancestor,
)

HALF = 0.5
"""Smallest probability at which two objects are taken as one."""
ANYWHERE_M, ANYWHERE_RAD = 30.0, 1.0
"""Standard deviations of an unknown alignment about the estimated one."""


@dataclass(frozen=True, kw_only=True)
class _Together:
    """Stacked n + m states in the first map's frame and their joint covariance."""

    states: Array  # (n + m, 3)
    covariance: Array  # (3 (n + m), 3 (n + m))


def merged(one: SavedMap, other: SavedMap, revision: str, same_frame: bool | None = None) -> SavedMap:
    """Merge two maps in the frame of ``one``; displaced objects are placed as in ``other``. Raises InputError."""
    _check(one, other)
    one, other = over_common_classes(one, other)
    comparison = Comparison.of(one, other, same_frame)
    probability = comparison.alignment_probability
    if probability < SURE:
        raise InputError(
            f"maps {one.map_id} and {other.map_id} cannot be aligned for sure, the likeliest way has probability"
            f" {probability:.2f}; merge maps that have more objects in common, or --same-frame if they are of one frame"
        )
    rows = _rows(comparison)
    together = _fused(_stacked(comparison), rows, len(one.objects), comparison.ours.frames)
    own = _blocks(together.covariance)[rows.kept]
    objects = merged_objects(one, other, rows, together.states[rows.kept], own, merged_existence(comparison, rows))
    kept = (3 * rows.kept[:, None] + np.arange(3)).ravel()
    joint = together.covariance[np.ix_(kept, kept)]
    return SavedMap(
        class_names=one.class_names or other.class_names,
        objects=objects,
        hypotheses=replace(independent(objects, one.coordinates), covariances=joint[None]),
        has_cross_covariances=True,
        looks=_looks(one.looks, other.looks, comparison.best.alignment.T_old_new),
        discarded_mass=1.0 - (1.0 - one.discarded_mass) * (1.0 - other.discarded_mass),
        descriptor_space=one.descriptor_space or other.descriptor_space,
        state_space=one.state_space,
        provenance=_provenance(one, other, revision),
    )


def _provenance(one: SavedMap, other: SavedMap, revision: str) -> Provenance:
    """Provenance of the merged map, whose ancestors are both maps, their recordings, and all of theirs."""
    ids = [one.map_id, other.map_id]
    ancestors = one.origins.union(other.origins, ids)
    return Provenance(source=json.dumps({"merged": ids}), revision=revision, ancestors=tuple(sorted(ancestors)))


def _check(one: SavedMap, other: SavedMap) -> None:
    """Raise InputError for maps that cannot be merged."""
    if one.map_id == other.map_id:
        raise InputError(f"both maps are {one.map_id}; name two maps")
    for first, second in ((one, other), (other, one)):
        if first.map_id in second.ancestors:
            raise InputError(
                f"map {second.map_id} came from map {first.map_id} and holds what that one knows; use it alone"
            )
    if are_of_one_recording(one, other):
        raise InputError(
            f"maps {one.map_id} and {other.map_id} are of one recording, which would count twice; use"
            f" {_later(one, other)} alone, or merge it with a map of another run"
        )
    spaces = {known.descriptor_space for known in (one, other) if known.objects.descriptors.shape[1]}
    if len(spaces) > 1:
        raise InputError(f"the maps' descriptors are of different spaces ({', '.join(sorted(spaces))}); use one model")


def _later(one: SavedMap, other: SavedMap) -> str:
    """Which of two maps of one recording has seen more of it, in words."""
    seen = [own.provenance.keyframe for own in (one, other)]
    return (
        "one of them"
        if seen[0] == seen[1] or not are_of_one_run(one, other)
        else f"the later one, {(one if seen[0] > seen[1] else other).map_id},"
    )


def _rows(comparison: Comparison) -> MergedRows:
    """Decide which pairs are one object, and which rows of the stacked states are kept."""
    count, ours, theirs = len(comparison.old.objects), comparison.ours.rows, comparison.theirs.rows
    same = [(int(ours[i]), int(theirs[j])) for i, j in zip(*np.nonzero(comparison.best.same > HALF), strict=True)]
    moved = [(int(ours[i]), int(theirs[j])) for i, j in zip(*np.nonzero(comparison.best.displaced > HALF), strict=True)]
    taken = {j for _, j in (*same, *moved)}
    places = {i: count + j for i, j in moved}
    first = [places.get(i, i) for i in range(count)]
    last = [count + j for j in theirs.tolist() if j not in taken]
    return MergedRows(same=tuple(same), displaced=tuple(moved), kept=np.array([*first, *last], dtype=int))


def _stacked(comparison: Comparison) -> _Together:
    """States of both maps in the first one's frame, before fusion."""
    one, other, alignment = comparison.old, comparison.new, comparison.best.alignment
    frames = comparison.ours.frames
    own, theirs = (frames.coordinates.of_poses(known.objects.poses) for known in (one, other))
    T = np.zeros(frames.size) if comparison.same_frame else alignment.T_old_new
    moved = frames.moved(T, theirs)
    turns = np.kron(np.eye(len(theirs)), frames.turn(T))
    square = turns @ joint_covariance(other) @ turns.T
    if not comparison.same_frame:
        slopes = frames.slopes(moved, alignment.centre).reshape(-1, frames.size)
        square = square + slopes @ np.diag(frames.sigmas(ANYWHERE_M, ANYWHERE_RAD)) ** 2 @ slopes.T
    size, whole = 3 * len(own), np.zeros((3 * (len(own) + len(theirs)),) * 2)
    whole[:size, :size], whole[size:, size:] = joint_covariance(one), square
    return _Together(
        states=np.concatenate([own, moved]), covariance=2.0 * whole if have_common_ancestor(one, other) else whole
    )


def _fused(known: _Together, rows: MergedRows, count: int, frames: MapFrames) -> _Together:
    """Fuse the pairs that are one unmoved object, up to the unmodelled map error (FLOOR_M, FLOOR_RAD)."""
    if not rows.same:
        return known
    pairs = np.array(rows.same)
    slopes = np.zeros((3 * len(pairs), len(known.covariance)))
    for number, (i, j) in enumerate(pairs.tolist()):
        at = slice(3 * number, 3 * number + 3)
        slopes[at, 3 * i : 3 * i + 3] = np.eye(3)
        slopes[at, 3 * (count + j) : 3 * (count + j) + 3] = -np.eye(3)
    off = frames.coordinates.difference(known.states[pairs[:, 0]], known.states[count + pairs[:, 1]])
    noise = np.tile(frames.coordinate_sigmas(FLOOR_M, FLOOR_RAD) ** 2, len(pairs))
    cross = slopes @ known.covariance
    gain = np.linalg.solve(cross @ slopes.T + np.diag(noise), cross).T
    states = known.states - (gain @ off.ravel()).reshape(-1, 3)
    if frames.coordinates.has_yaw:
        states[:, 2] = wrap_angle(states[:, 2])
    square = known.covariance - gain @ cross
    return replace(known, states=states, covariance=0.5 * (square + square.T))


def _blocks(joint: Array) -> Array:
    """(n, 3, 3) diagonal blocks of a joint covariance."""
    count = len(joint) // 3
    return np.array(np.einsum("iaib->iab", joint.reshape(count, 3, count, 3)))


def _looks(one: ViewedFrom, other: ViewedFrom, T: Array) -> ViewedFrom:
    """Combined looks of both robots; empty where one map has none, or the sensor regions differ."""
    if not (len(one.path) and len(other.path) and np.allclose(one.region, other.region)):
        return ViewedFrom()
    moved = se2.compose(np.broadcast_to(T, other.path.shape), other.path)
    return ViewedFrom(path=np.concatenate([one.path, moved]), region=one.region)

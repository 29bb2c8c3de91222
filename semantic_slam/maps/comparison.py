"""Comparison of two maps: object correspondences over all plausible alignments."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.maps.alignments import aligned, in_place
from semantic_slam.maps.correspondence import Correspondence
from semantic_slam.maps.landmarks import Landmarks, compared_rows
from semantic_slam.maps.likelihood import DISPLACED_SHARE, GONE_SHARE
from semantic_slam.maps.saved_map import SavedMap, are_of_one_run

SURE = 0.9
"""Smallest probability at which two maps are taken to be of one place, and an alignment is accepted for a merge."""
SEEN_IN_A_LOOK = 0.3
"""Default probability that an object in the sensor's region is detected, occlusion included."""
PLACED_M = 1.0
"""Largest frame error [m] at which a run that started from a map knew which map objects it looked at."""
LEAST_UNSEEN = 1e-3
"""Probability that an object is never detected however often it is in view: it may be permanently hidden."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Correspondences of n objects of the old map with m of the new one."""

    old: SavedMap
    new: SavedMap
    ours: Landmarks  # n
    theirs: Landmarks  # m
    one_place: float  # probability that both are of one place, on which all others are conditioned
    alignments: tuple[tuple[float, Correspondence], ...]  # with their probabilities, most likely first
    same_frame: bool  # else aligned by object correspondences

    @classmethod
    def of(cls, old: SavedMap, new: SavedMap, same_frame: bool | None = None) -> "Comparison":
        """Compare two maps; ``same_frame`` None: True where provenance says they share a frame. Raises InputError."""
        if old.state_space != new.state_space:
            raise InputError("one of the maps is of the plane, the other of space; name two of one state_space")
        same_frame = are_of_one_frame(old, new) if same_frame is None else same_frame
        names = [name for name in old.class_names if name in new.class_names]
        known, rows = compared_rows(old), compared_rows(new)
        if new.provenance.started_from == old.map_id:
            rows = rows[~_only_told(old, new, rows)]
        if not len(known) or not len(rows):
            raise InputError("one of the maps has no object that is known to exist; compare maps with objects")
        ours, theirs = Landmarks.of(old, names, known), Landmarks.of(new, names, rows)
        # Used until the alignment is known: whether its place was looked at hardly affects an object's counterpart.
        log_absent = np.log(1.0 - ours.existence + ours.existence * (GONE_SHARE + LEAST_UNSEEN))
        if same_frame:
            is_continued = new.provenance.started_from == old.map_id or are_of_one_run(old, new)
            found = in_place(ours, theirs, log_absent, is_continued=is_continued)
        else:
            found = aligned(ours, theirs, log_absent)
        if not found.of_one_place:
            raise InputError("the maps cannot be aligned: no object of one may be one of the other; name other maps")
        if found.one_place < SURE:
            raise InputError(
                f"maps {old.map_id} and {new.map_id} have too little in common to be of one place for sure, P ="
                f" {found.one_place:.2f}; name maps that have more objects in common, or --same-frame if they are of"
                " one frame"
            )
        return cls(
            old=old,
            new=new,
            ours=ours,
            theirs=theirs,
            one_place=found.one_place,
            alignments=found.of_one_place,
            same_frame=same_frame,
        )

    @property
    def alignment_probability(self) -> float:
        """Probability that the maps are of one place and lie as the most likely alignment has it."""
        return self.one_place * self.alignments[0][0]

    @property
    def best(self) -> Correspondence:
        """Correspondence under the most likely alignment."""
        return self.alignments[0][1]

    @cached_property
    def same(self) -> Array:
        """(n, m) probabilities that two objects are the same one, not moved."""
        return np.asarray(np.sum([weight * own.same for weight, own in self.alignments], axis=0))

    @cached_property
    def displaced(self) -> Array:
        """(n, m) probabilities that two objects are the same one, displaced."""
        return np.asarray(np.sum([weight * own.displaced for weight, own in self.alignments], axis=0))

    @cached_property
    def unseen(self) -> Array:
        """(n,) probability that an old object without counterpart is still there but unseen, rather than gone."""
        frames, off = self.ours.frames, self.best.alignment.T_old_new
        places = frames.moved(frames.inverse(off), self.ours.states)[:, :2]
        missed = np.maximum((1.0 - _seen_in_a_look(self.new)) ** self.new.looks.counts(places), LEAST_UNSEEN)
        stays = (1.0 - GONE_SHARE - DISPLACED_SHARE) * missed
        found = np.asarray(stays / (stays + GONE_SHARE))
        if self.new.provenance.started_from == self.old.map_id and np.linalg.norm(off[:-1]) < PLACED_M:
            self._as_the_run_says(found)
        return found

    def _as_the_run_says(self, unseen: Array) -> None:
        """Override with the run's own estimates for old-map objects whose disappearance it has judged."""
        objects = self.new.objects
        if np.isnan(objects.missing).all():
            return
        for row, number in enumerate(self.old.objects.ids[self.ours.rows].tolist()):
            (at,) = np.nonzero(objects.ids == number)
            if len(at) and objects.sightings[at[0]] > 0.0:
                continue  # the object, or another in its place, was seen
            there = float(objects.existence[at[0]]) if len(at) else 0.0  # else the run has removed it
            missing = float(np.nan_to_num(objects.missing[at[0]])) if len(at) else 1.0
            unseen[row] = np.clip(there / max(there + missing, 1e-12), LEAST_UNSEEN, 1.0 - LEAST_UNSEEN)

    @cached_property
    def new_positions(self) -> Array:
        """(m, 2) positions of the new objects in the old map's frame [m]; (m, 3) in space."""
        frames = self.theirs.frames
        return frames.moved(self.best.alignment.T_old_new, self.theirs.states)[:, : frames.num_axes]


def are_of_one_frame(old: SavedMap, new: SavedMap) -> bool:
    """Whether both maps share one frame according to their provenance.

    A common ancestor is not enough: a merged map is in the frame of its first one alone.
    """
    one, other = old.provenance.started_from, new.provenance.started_from
    return other == old.map_id or one == new.map_id or (one == other != "") or are_of_one_run(old, new)


def _only_told(old: SavedMap, new: SavedMap, rows: Index) -> Flags:
    """Which objects of a continued map stem from the old map alone, without sightings of their own."""
    return np.asarray(np.isin(new.objects.ids[rows], old.objects.ids) & (new.objects.sightings[rows] == 0.0))


def _seen_in_a_look(known: SavedMap) -> float:
    """Empirical detection rate of a map's objects in the sensor's region, occlusion included."""
    exist = np.flatnonzero((known.objects.existence > 0.5) & np.isfinite(known.objects.sightings))
    if not len(known.looks.path) or not len(exist):
        return SEEN_IN_A_LOOK
    looks = known.looks.counts(planar_from_pose_vector(known.objects.poses[exist])[:, :2]).sum()
    share = (known.objects.sightings[exist].sum() + SEEN_IN_A_LOOK) / (looks + 1.0)
    return float(np.clip(share, 0.01, 0.99))

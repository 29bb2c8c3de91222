"""Runs: uninterrupted sightings of a history's objects, and the histories in which a return was to another object.

Where an object is seen again after an absence, the robot may have mistaken another one for it. Sightings without an
absence are tied together by their surroundings, and stay one object.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index

ABSENT = 5
"""Keyframes without a sighting of an object after which its next one is a return."""


@dataclass(frozen=True, kw_only=True)
class Parting:
    """A history that splits an object at a return: sightings from there on, or up to the next one, are of another."""

    objects: Index  # (A,) object of each atom
    returned: int  # atom that begins with the return
    parted: tuple[int, int]  # the two objects that were one before


@dataclass(frozen=True, kw_only=True)
class Runs:
    """R runs, each of one object of one history. The atoms are the M objects of a map, and then the runs."""

    detections: Index  # (n,) atom of each detection
    objects: Index  # (M + R,) object of each atom in the history; those of the map have the numbers 0 to M - 1
    keyframes: Index  # (M + R,) where each run begins, 0 for an object of the map
    seen: Flags  # (M + R, T) whether seen in each frame
    num_mapped: int  # M

    @classmethod
    def of(cls, objects: Index, keyframes: Index, num_mapped: int, num_keyframes: int) -> Self:
        """Runs of n detections of ``objects`` at ``keyframes``, both (n,)."""
        atoms = np.zeros(len(objects), dtype=int)
        own, begins = list(range(num_mapped)), [0] * num_mapped
        for number in np.unique(objects).tolist():
            rows = np.flatnonzero(objects == number)
            for part in np.split(rows, np.flatnonzero(np.diff(keyframes[rows]) > ABSENT) + 1):
                atoms[part] = len(own)
                own.append(number)
                begins.append(int(keyframes[part[0]]))
        seen = np.zeros((len(own), num_keyframes), dtype=bool)
        seen[atoms, keyframes] = True
        return cls(
            detections=atoms,
            objects=np.array(own, dtype=int),
            keyframes=np.array(begins, dtype=int),
            seen=seen,
            num_mapped=num_mapped,
        )

    def partings(self) -> Iterator[Parting]:
        """Two partings per return: all later sightings, or those until the next return, become another object."""
        new = int(self.objects.max(initial=-1)) + 1
        for number in np.unique(self.objects).tolist():
            atoms = np.flatnonzero(self.objects == number)
            atoms = atoms[atoms >= self.num_mapped]
            for place in range(0 if number < self.num_mapped else 1, len(atoms)):
                rest = [atoms[place:], atoms[place : place + 1]]
                for part in rest if place + 1 < len(atoms) else rest[:1]:
                    objects = self.objects.copy()
                    objects[part] = new
                    yield Parting(objects=objects, returned=int(atoms[place]), parted=(number, new))

    def seen_of(self, objects: Index) -> Flags:
        """(N, T) whether each object 0 to N - 1 is seen in each frame, with atoms of ``objects`` (M + R,)."""
        found = np.zeros((int(objects.max(initial=-1)) + 1, self.seen.shape[1]), dtype=bool)
        np.logical_or.at(found, objects, self.seen)
        return found


def numbered(objects: Index) -> Index:
    """(A,) object ids replaced by the numbers 0 to N - 1, in the same order."""
    return np.asarray(np.unique(objects, return_inverse=True)[1])


def offsets(places: Array, covariance: Array) -> tuple[Array, Array]:
    """(N, N, 2) offsets between N positions, and (N, N, 2, 2) their covariances, from the positions' (2 N, 2 N)."""
    count = len(places)
    blocks = covariance.reshape(count, 2, count, 2).transpose(0, 2, 1, 3)
    own = blocks[np.arange(count), np.arange(count)]
    return places[None] - places[:, None], own[:, None] + own[None] - blocks - blocks.transpose(1, 0, 2, 3)

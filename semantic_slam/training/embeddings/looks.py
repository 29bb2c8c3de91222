"""The vectors of each object's views, from the sightings of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.runs import Run
from semantic_slam.training.sightings import (
    LEAST_RANGE_M,
    SightingReader,
    Sightings,
    sightings_of,
    stretch_edges,
    stretch_of,
)
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground, SeenVectors
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.vectors import reduced

STRETCHES = 5
"""Parts of a drive; where there is no other run, each is held out once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LookView:
    """Vector of one view of an object, and its viewpoint."""

    keyframe: int
    detection: int  # of the keyframe
    stretch: int  # of the drive
    vector: Array  # (L,)
    place: CameraPlaces  # of one camera


@dataclass(frozen=True, kw_only=True, eq=False)
class LookTrack:
    """Views that are of one object, in the order of the drive."""

    object_id: int
    views: tuple[LookView, ...]
    weight: float  # probability that the object is there and these are its views


@dataclass(frozen=True, kw_only=True, eq=False)
class RunLooks:
    """The vectors of one run, reduced to L components."""

    tracks: Sequence[LookTrack]
    background: EmbeddingBackground
    sizes: frozenset[int] = frozenset()  # components of the vectors as they were sent

    @classmethod
    def of(cls, run: Run, dimensions: int) -> Self:
        """Vectors as the hypotheses at the end of a run associate them; ``dimensions``: L."""
        reader, edges = SightingReader(run), stretch_edges(run, STRETCHES)
        stamps, told = [belief.stamp_ns for belief in run.record.beliefs], run.record.measurements
        sent = {number: reader.measured(number).embeddings for number, stamp in enumerate(stamps) if stamp in told}
        vectors = {number: reduced(own, dimensions) for number, own in sent.items()}
        rows = np.concatenate([np.zeros((0, dimensions)), *vectors.values()])
        sizes = {own.shape[1] for number, own in sent.items() if np.isfinite(vectors[number]).any()}
        found = [_track(reader, own, vectors, edges) for own in sightings_of(run)] if sizes else []
        return cls(
            tracks=[own for own in found if own.views],
            background=SeenVectors.none(dimensions).with_vectors(rows).background,
            sizes=frozenset(sizes),
        )

    @property
    def num_views(self) -> int:
        """Number of different views of objects."""
        return len({(view.keyframe, view.detection) for track in self.tracks for view in track.views})


def _track(reader: SightingReader, own: Sightings, vectors: Mapping[int, Array], edges: Sequence[int]) -> LookTrack:
    """The views of an object that have a vector; ``vectors``: (D, L) by keyframe."""
    views = []
    for keyframe, detection in own.places:
        vector = vectors[keyframe][reader.row(keyframe, detection)]
        if np.isfinite(vector).all():
            azimuth, elevation, away = reader.seen_from(own.object_id, keyframe)
            place = CameraPlaces.one(azimuth, float(np.log(max(away, LEAST_RANGE_M))), elevation)
            stretch = stretch_of(reader.stamp_ns(keyframe), edges)
            views.append(LookView(keyframe=keyframe, detection=detection, stretch=stretch, vector=vector, place=place))
    return LookTrack(object_id=own.object_id, views=tuple(views), weight=own.weight)

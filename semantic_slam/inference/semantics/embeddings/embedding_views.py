"""Appearance embeddings as evidence: objects look as they looked before, whatever their heading.

Given the positions of camera and objects, the embeddings of one object depend only on which spreads are usual, and all
objects of a hypothesis inform that. They do not inform positions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.detection_vectors import DetectionVectors
from semantic_slam.inference.semantics.embeddings.appearance_views import AppearanceView, record_of_views
from semantic_slam.inference.semantics.embeddings.reassigned_vectors import reassigned_vectors
from semantic_slam.inference.semantics.interface import (
    ClassModels,
    LogPriorOf,
    SemanticEvidence,
    SemanticInput,
    reassociates,
)
from semantic_slam.inference.semantics.view_steps import ViewSteps, view_steps
from semantic_slam.inference.states.lineage import Reassigned
from semantic_slam.inference.states.object_views import ObjectViews, appearance_of
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel, EmbeddingRecord
from semantic_slam.viewpoint.labels.confusion import STEP_RAD


class EmbeddingViews:
    """Evidence of appearance embeddings; the record of an object is its appearance so far."""

    def __init__(
        self, model: EmbeddingModel, known: Mapping[int, EmbeddingRecord], *, keeps_views: bool = False
    ) -> None:
        """``known``: object id -> appearance stored in a map. ``keeps_views``: views may be reassigned later."""
        self._model, self._known, self._nothing = model, known, model.start()
        self.retells = keeps_views

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the embedding model, which the kind of class models must have."""
        assert models.embeddings is not None
        return cls(models.embeddings, models.appearances, keeps_views=reassociates(models.configuration))

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Log evidence of each candidate's embeddings relative to the background, and the records after it."""
        rows, told = given.candidates.assignments, given.step.vectors
        assert told is not None
        steps = view_steps(given)
        keyframe = given.step.index if self.retells else None
        shared = [
            _Shared(model=self._model, told=told, views=parent.views, keyframe=keyframe) for parent in given.parents
        ]
        total, records = np.zeros(len(rows)), [dict[int, ObjectViews]() for _ in range(len(rows))]
        ratios: dict[tuple[int, _View], Array] = {}
        for number, index in enumerate(given.used.tolist()):
            if np.isnan(told.vectors[index]).any():
                continue
            for row in np.flatnonzero(rows.objects[:, number] >= 0).tolist():
                parent = int(rows.parents[row])
                object_id = given.object_ids[int(rows.objects[row, number])]
                before = records[row].get(object_id, given.parents[parent].views.get(object_id))
                record = appearance_of(before) or self._known.get(object_id, self._nothing)
                seen = ViewSteps(*steps[row, number].tolist())
                view = _View(index, seen.direction, seen.log_range, seen.elevation)
                earlier = () if before is None else before.appearance_views
                added, records[row][object_id] = shared[parent].with_view(record, earlier, object_id, view, ratios)
                total[row] += added
        return SemanticEvidence.of(total, records)

    def retold(
        self, views: Mapping[int, ObjectViews], changes: Sequence[Reassigned], log_prior_of: LogPriorOf
    ) -> tuple[float, dict[int, ObjectViews]]:
        """Log gain of reassigning the vectors of detections by ``changes``, and the records afterwards."""
        return reassigned_vectors(self._model, views, changes)


@dataclass(frozen=True)
class _View:
    """A detection and its viewpoint, in discrete steps."""

    index: int
    azimuth: int
    log_range: int
    elevation: int

    @cached_property
    def place(self) -> CameraPlaces:
        """The camera's place around the object."""
        return CameraPlaces.one(STEP_RAD * self.azimuth, STEP_RAD * self.log_range, STEP_RAD * self.elevation)


@dataclass(frozen=True, kw_only=True)
class _Shared:
    """What the objects of one parent share, and the views computed for it."""

    model: EmbeddingModel
    told: DetectionVectors
    views: Mapping[int, ObjectViews]
    keyframe: int | None  # whose views are kept; None: they are not
    known: dict[tuple[int, int, _View], tuple[float, ObjectViews]] = field(default_factory=dict)

    def with_view(
        self,
        record: EmbeddingRecord,
        earlier: tuple[AppearanceView, ...],
        object_id: int,
        view: _View,
        ratios: dict[tuple[int, _View], Array],
    ) -> tuple[float, ObjectViews]:
        """Log evidence of a view of an object, and the updated record; ``ratios`` are shared by all parents.

        ``earlier`` are the object's views so far, where they are kept.
        """
        key = id(record), object_id, view
        if key not in self.known:
            vector, background = self.told.vectors[view.index], self.told.background
            if (id(record), view) not in ratios:  # shared between hypotheses
                ratios[id(record), view] = record.log_ratios(vector, background, view.place)[:, 0]
            ratio, usual = ratios[id(record), view], self._usual(object_id)
            after = record.after(vector, ratio, usual, background, view.place)
            self.known[key] = (
                self.model.evidence(record, ratio, usual),
                record_of_views(after, (*earlier, *self._kept(view))),
            )
        return self.known[key]

    def _kept(self, view: _View) -> tuple[AppearanceView, ...]:
        """The view as it is kept, where views are kept."""
        if self.keyframe is None:
            return ()
        told, detection = self.told, (self.keyframe, view.index)
        vector = told.vectors[view.index]
        return (AppearanceView(detection=detection, vector=vector, background=told.background, place=view.place),)

    def _usual(self, object_id: int) -> Array:
        """(R,) log probabilities of the settings for one object, by all others."""
        own = appearance_of(self.views.get(object_id))
        return self.model.usual(self._told if own is None else self._told - own.told_settings)

    @cached_property
    def _told(self) -> Array:
        """(R,) sum of the evidence of all objects' views on the settings."""
        told = np.zeros(len(self.model.settings[0]))
        for number in sorted(self.views):  # fixed order, for bitwise equal sums
            own = appearance_of(self.views[number])
            if own is not None:
                told += own.told_settings
        return told

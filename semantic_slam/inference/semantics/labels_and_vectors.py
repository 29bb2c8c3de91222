"""Detector labels and appearance vectors as two measurements of each detection, independent given its object.

    P(words, vector | object) = P(words | class of the object) P(vector | appearance of the object)

Log evidences of an association add up, and the record of an object's views has a part of each. Each part handles how
its own errors repeat between views. The appearance of an object is not tied to its class: that objects of one class
look alike is left out, see docs/theory.md for what this errs by.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.detector.detector_labels import DetectorLabels
from semantic_slam.inference.semantics.embeddings.embedding_views import EmbeddingViews
from semantic_slam.inference.semantics.interface import ClassModels, LogPriorOf, SemanticEvidence, SemanticInput
from semantic_slam.inference.states.lineage import Reassigned
from semantic_slam.inference.states.object_views import ObjectViews


class LabelsAndVectors:
    """Evidence of labels and of vectors; each part reads and writes its own fields of an object's record."""

    def __init__(self, labels: DetectorLabels, vectors: EmbeddingViews) -> None:
        self._labels, self._vectors = labels, vectors
        self.retells = labels.retells and vectors.retells

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the label model and the embedding model, which the kind of class models must both have."""
        return cls(DetectorLabels.of(models), EmbeddingViews.of(models))

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Log evidence of each candidate's labels and vectors, and the records with both after it."""
        labels, vectors = self._labels.weigh(given), self._vectors.weigh(given)
        before, parents = [parent.views for parent in given.parents], given.candidates.assignments.parents

        def records(rows: Sequence[int]) -> list[dict[int, ObjectViews]]:
            parts = zip(rows, labels.records(rows), vectors.records(rows), strict=True)
            return [_with_appearances(named, {**before[parents[row]], **seen}) for row, named, seen in parts]

        return replace(labels, log_weights=labels.log_weights + vectors.log_weights, records=records)

    def log_pairs(
        self,
        step: Step,
        views: Mapping[int, ObjectViews],
        object_ids: Sequence[int],
        log_prior: Array,
        log_ranges: Array,
        variances: Array,
    ) -> Array:
        """Log evidence of labels alone, pair by pair: for ranking, where the sides that vectors show are not known."""
        return self._labels.log_pairs(step, views, object_ids, log_prior, log_ranges, variances)

    def log_of_one(self, own: ObjectViews, other: ObjectViews, log_prior: Array) -> float:
        """Log evidence of the labels alone of two objects as of one, relative to that as of two."""
        return self._labels.log_of_one(own, other, log_prior)

    def retold(
        self, views: Mapping[int, ObjectViews], changes: Sequence[Reassigned], log_prior_of: LogPriorOf
    ) -> tuple[float, dict[int, ObjectViews]]:
        """Log gain of reassigning labels and vectors of detections by ``changes``, and the records afterwards."""
        by_labels, named = self._labels.retold(views, changes, log_prior_of)
        by_vectors, seen = self._vectors.retold(views, changes, log_prior_of)
        return by_labels + by_vectors, _with_appearances(named, seen)


def _with_appearances(named: Mapping[int, ObjectViews], seen: Mapping[int, ObjectViews]) -> dict[int, ObjectViews]:
    """The records of labels ``named``, each with the appearance that its object was ``seen`` to have, if it was."""
    return {
        number: replace(own, appearance=seen[number].appearance, appearance_views=seen[number].appearance_views)
        if number in seen
        else own
        for number, own in named.items()
    }

"""Appearance of a map's objects: the embedding vectors of their views, associated by the best history.

Vectors are compared in full dimension, whatever the run reduced them to and whatever its class models are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from semantic_slam.class_models.embedding import embedding_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.history import best_history, best_index, lineage
from semantic_slam.evaluation.seen_from import seen_from
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground, SeenVectors
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel, EmbeddingRecord
from semantic_slam.viewpoint.embeddings.vectors import reduced

LEAST_RANGE_M = 0.05
"""Lower bound of view distances [m]."""


@dataclass(frozen=True, kw_only=True)
class SeenView:
    """Embedding vector of one view of an object, with its viewpoint."""

    object_id: int
    vector: Array  # (F,)
    place: CameraPlaces  # of one camera


@dataclass(frozen=True, kw_only=True)
class Appearances:
    """Appearance records of a map's objects and the background of all vectors; F components."""

    model: EmbeddingModel
    seen: SeenVectors  # all
    records: Mapping[int, EmbeddingRecord]  # by object id

    @classmethod
    def of(
        cls,
        views: Sequence[SeenView],
        others: Sequence[Array],
        settings: SemanticModelConfiguration,
        before: "Appearances | None" = None,
    ) -> "Appearances":
        """Build from views in temporal order, and vectors (F,) of no object, after those of ``before``.

        Raises InputError.
        """
        sizes = {len(view.vector) for view in views} | ({before.size} if before else set())
        if len(sizes) != 1:
            raise InputError(
                "no object of the map has a vector of appearance; let the detector send embeddings (DetectionArray)"
                if not sizes
                else f"embeddings of {sorted(sizes)} components are mixed; let one network alone send them"
            )
        (size,) = sizes
        model = replace(embedding_model(settings), dimensions=size)
        vectors = reduced(np.array([view.vector for view in views]).reshape(-1, size), size)
        alike = np.array([vector for vector in others if len(vector) == size]).reshape(-1, size)
        seen = before.seen if before else SeenVectors.none(size)
        seen = seen.with_vectors(vectors).with_vectors(reduced(alike, size))
        background, records = seen.background, dict(before.records) if before else {}
        for vector, view in zip(vectors, views, strict=True):
            if np.isfinite(vector).all():
                record = records.get(view.object_id, model.start())
                settings_of_others = sum(
                    (own.told_settings for n, own in sorted(records.items()) if n != view.object_id), np.zeros(1)
                )
                ratio = record.log_ratios(vector, background, view.place)[:, 0]
                usual = model.usual(np.broadcast_to(settings_of_others, ratio.shape))
                records[view.object_id] = record.after(vector, ratio, usual, background, view.place)
        return cls(model=model, seen=seen, records=records)

    @property
    def size(self) -> int:
        """F, number of components of a vector."""
        return self.model.dimensions

    @property
    def background(self) -> EmbeddingBackground:
        """Background distribution of vectors of arbitrary objects."""
        return self.seen.background

    @cached_property
    def usual(self) -> Array:
        """(R,) log prior of an object's settings."""
        settings = [own.told_settings for _, own in sorted(self.records.items())]
        return self.model.usual(np.sum(settings, axis=0))

    def vector(self, given: Array) -> Array:
        """(F,) unit vector. Raises InputError where ``given`` cannot come from this map's network."""
        size = self.size
        if np.shape(given) != (size,):
            raise InputError(
                f"the vector has {np.size(given)} components, the objects' have {size}; take that of the same network"
            )
        (unit,) = reduced(np.asarray(given, dtype=np.float64)[None], size)
        if np.isnan(unit).any():
            raise InputError("the vector has no direction: it is zero or not finite; give another")
        return np.asarray(unit)


def appearances_of(
    beliefs: Sequence[HybridBelief],
    measurements: Mapping[int, SemanticMeasurements],
    settings: SemanticModelConfiguration,
    before: Appearances | None = None,
) -> Appearances:
    """Build from a run's beliefs and measurements (by stamp), after those of ``before``. Raises InputError."""
    return Appearances.of(*seen_views(beliefs, measurements), settings, before)


def seen_views(
    beliefs: Sequence[HybridBelief], measurements: Mapping[int, SemanticMeasurements]
) -> tuple[list[SeenView], list[Array]]:
    """Views of objects in temporal order, associated by the best history, and vectors of no object."""
    last = beliefs[-1]
    places = {
        int(number): pose[:3]
        for number, pose in zip(last.object_ids, last.object_poses, strict=True)
        if np.isfinite(pose).all()
    }
    views, others = list[SeenView](), list[Array]()
    for belief, ids, ancestor in zip(beliefs, best_history(beliefs), lineage(beliefs), strict=True):
        measured = measurements.get(belief.stamp_ns)
        if measured is None or not measured.embeddings.shape[1]:
            continue
        rows = {int(number): row for row, number in enumerate(measured.detection_ids)}
        robot = belief.poses[ancestor if ancestor >= 0 else best_index(belief)]
        for column, detection in enumerate(belief.detection_ids):
            vector = measured.embeddings[rows[int(detection)]] if int(detection) in rows else None
            number = -1 if ids is None else int(ids[column])
            if vector is None or not np.isfinite(vector).all() or not vector.any():
                continue
            if number in places:
                in_space = belief.state_space == "spatial"
                at = seen_from(robot, places[number], measured.sensor_position, in_space=in_space)
                views.append(SeenView(object_id=number, vector=vector, place=_place(*at)))
            else:
                others.append(vector)
    return views, others


def _place(azimuth: float, elevation: float, distance: float) -> CameraPlaces:
    return CameraPlaces.one(azimuth, float(np.log(max(distance, LEAST_RANGE_M))), elevation)

"""Appearance records of one object: of its vectors so far, and the views that they came from."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.model import EmbeddingRecord


@dataclass(frozen=True, kw_only=True)
class AppearanceView:
    """One vector of an object: from where, and what vectors of arbitrary objects were like then."""

    detection: tuple[int, int]  # keyframe, and index among its detections
    vector: Array  # (L,)
    background: EmbeddingBackground
    place: CameraPlaces  # of one camera


def record_of_views(record: EmbeddingRecord, views: tuple[AppearanceView, ...]) -> ObjectViews:
    """The record of an object's views; vectors carry no class. ``views`` are empty where they are not kept."""
    return ObjectViews(
        log_likelihood=np.zeros(0), mutual_information=float("nan"), appearance=record, appearance_views=views
    )

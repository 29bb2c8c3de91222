"""Appearance embeddings of detections, and the background distribution that they are compared with."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground


@dataclass(frozen=True, kw_only=True)
class DetectionVectors:
    """Embeddings of D detections, as made by :func:`semantic_slam.viewpoint.embeddings.vectors.reduced`."""

    vectors: Array  # (D, L); NaN rows where a detection has none
    background: EmbeddingBackground  # from all vectors up to this keyframe

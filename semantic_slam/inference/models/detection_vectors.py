"""What detections look like: vectors of appearance, and the background that they stand out from."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground


@dataclass(frozen=True, kw_only=True)
class DetectionVectors:
    """Vectors of D detections, as :func:`semantic_slam.viewpoint.embeddings.vectors.reduced` makes them."""

    vectors: Array  # (D, L), rows of NaN where a detection has none
    background: EmbeddingBackground  # from all vectors up to this keyframe

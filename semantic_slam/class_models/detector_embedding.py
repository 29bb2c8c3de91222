"""Class models from a detector's labels and from the vectors of its detections, both as evidence."""

from semantic_slam.class_models.detector import label_model
from semantic_slam.class_models.embedding import embedding_model
from semantic_slam.class_models.kind import ClassModelKind

DETECTOR_EMBEDDING = ClassModelKind(
    labels=label_model,
    embeddings=embedding_model,
    semantics="labels_and_vectors",
    carried="labels_and_vectors",
    has_factors=False,
    repeats_errors=False,
)
"""Labels tell of which class an object is; labels and vectors tell which detections are of one object."""

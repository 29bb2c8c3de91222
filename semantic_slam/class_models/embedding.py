"""The configured model of vectors of appearance: nothing to train, nothing to load."""

from semantic_slam.class_models.kind import ClassModelKind, class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.viewpoint.embedding_model import EmbeddingModel


def load_embedding_model(settings: SemanticModelConfiguration) -> EmbeddingModel | None:
    """The model of what objects look like, or None where vectors of appearance say nothing. Raises InputError."""
    load = class_model_kind(settings).embeddings
    return load(settings) if load is not None else None


def embedding_model(settings: SemanticModelConfiguration) -> EmbeddingModel:
    """As the parameters have it, whatever the kind. Raises InputError."""
    for name, shares in (("spread_shares", settings.spread_shares), ("noise_shares", settings.noise_shares)):
        if not shares or not 0.0 < min(shares) <= max(shares) < 1.0:
            raise InputError(f"semantic_model.{name} must lie between 0 and 1, one at least; correct them")
    if max(settings.spread_shares) + max(settings.noise_shares) >= 1.0:
        raise InputError("semantic_model.spread_shares and noise_shares leave nothing to objects; lower the largest")
    return EmbeddingModel(
        dimensions=settings.embedding_dimensions,
        spread_shares=settings.spread_shares,
        noise_shares=settings.noise_shares,
        repeat_rad=settings.repeat_rad,
        outlier_share=settings.outlier_share,
    )


EMBEDDING = ClassModelKind(
    embeddings=embedding_model,
    semantics="embedding_views",
    carried="embedding_views",
    has_factors=False,
    repeats_errors=False,
)
"""Vectors of appearance that detections carry, without classes."""

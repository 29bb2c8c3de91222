"""Loading of the configured embedding model: generic defaults, or learned from runs of this network."""

from pathlib import Path

from semantic_slam.class_models.fitted_part import is_of_vectors
from semantic_slam.class_models.kind import ClassModelKind, class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
from semantic_slam.viewpoint.embeddings.store import ANEW, read_embeddings


def load_embedding_model(settings: SemanticModelConfiguration, bag_sha256: str = "") -> EmbeddingModel | None:
    """Load the embedding model, or None where embeddings are not used. Raises InputError.

    ``bag_sha256`` is the digest of the bag to run: if it was part of the fit, parameters learned from the others apply.
    """
    load = class_model_kind(settings).embeddings
    if load is None:
        return None
    model = load(settings)
    return _fitted(model, settings, bag_sha256) if load is embedding_model and is_of_vectors(settings) else model


def _fitted(model: EmbeddingModel, settings: SemanticModelConfiguration, bag_sha256: str) -> EmbeddingModel:
    try:
        return read_embeddings(Path(settings.path)).model(model, bag_sha256)
    except ValueError as fault:
        raise InputError(f"{settings.path}: {fault}; set them as they were, or {ANEW}") from None


def embedding_model(settings: SemanticModelConfiguration) -> EmbeddingModel:
    """Embedding model from the configuration parameters alone. Raises InputError."""
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
"""Class models from embedding vectors in the detections, without classes."""

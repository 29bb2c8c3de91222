"""Loading of the configured embedding model: generic defaults, or learned from runs of this network."""

from pathlib import Path

from semantic_slam.class_models.kind import ClassModelKind, class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.model_files import kind_of
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
from semantic_slam.viewpoint.embeddings.store import ANEW, FittedEmbeddings, read_embeddings
from semantic_slam.viewpoint.embeddings.store import FORMAT as VECTORS
from semantic_slam.viewpoint.labels.store import FORMAT as LABELS
from semantic_slam.viewpoint.labels.store import read_labels


def load_embedding_model(settings: SemanticModelConfiguration, bag_sha256: str = "") -> EmbeddingModel | None:
    """Load the embedding model, or None where embeddings are not used. Raises InputError.

    ``bag_sha256`` is the digest of the bag to run: if it was part of the fit, parameters learned from the others apply.
    """
    load = class_model_kind(settings).embeddings
    if load is None:
        return None
    model = load(settings)
    fitted = fitted_vectors(settings)
    if fitted is None:
        return model
    try:
        return fitted.model(model, bag_sha256)
    except ValueError as fault:
        raise InputError(f"{settings.path}: {fault}; set them as they were, or {ANEW}") from None


def fitted_vectors(settings: SemanticModelConfiguration) -> FittedEmbeddings | None:
    """Vectors' part of the configured file; None without a file, where it is of labels, or where vectors are not used.

    Raises InputError, also where labels are not used and the file has nothing else.
    """
    kind, path = class_model_kind(settings), Path(settings.path)
    if not settings.path or kind.embeddings is not embedding_model:
        return None
    if kind_of(path) != LABELS.kind:
        return read_embeddings(path) if kind.labels is None or kind_of(path) == VECTORS.kind else None
    vectors = read_labels(path).vectors
    if vectors is None and kind.labels is None:
        raise InputError(
            f"{path}: was fitted to labels alone; fit it to runs of semantic_model.kind: detector_embedding or"
            " embedding, whose detections have vectors"
        )
    return vectors


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

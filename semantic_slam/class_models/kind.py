"""Definition of a kind of class models, the plug-in behind a value of ``semantic_model.kind``."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from semantic_slam.errors import InputError
from semantic_slam.registry import CLASS_MODELS

if TYPE_CHECKING:
    from semantic_slam.configuration import SemanticModelConfiguration
    from semantic_slam.latent.model import DescriptorModel
    from semantic_slam.perception.collaborators import FeatureExtractor
    from semantic_slam.viewpoint.appearance import KnownAppearance
    from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
    from semantic_slam.viewpoint.labels.model import LabelModel
    from semantic_slam.viewpoint.model import ViewpointModel


@dataclass(frozen=True, kw_only=True)
class ClassModelKind:
    """Loaders of the models, and the semantics (names in the registry ``SEMANTICS``) that process their views.

    A fitted viewpoint model only needs ``viewpoint``. Loaders take the configuration group ``semantic_model`` and raise
    InputError.
    """

    viewpoint: "Callable[[SemanticModelConfiguration], ViewpointModel] | None" = None  # P(z | c, viewpoint)
    descriptors: "Callable[[SemanticModelConfiguration], DescriptorModel] | None" = None  # P(f | viewpoint, e) instead
    labels: "Callable[[SemanticModelConfiguration, str], LabelModel] | None" = (
        None  # a detector's labels instead; the string is the digest of the run's bag, or ""
    )
    embeddings: "Callable[[SemanticModelConfiguration], EmbeddingModel] | None" = None  # embedding vectors, or both
    extractor: "Callable[[SemanticModelConfiguration], FeatureExtractor] | None" = None  # f, None: class probabilities
    appearance: "Callable[[SemanticModelConfiguration], KnownAppearance | None] | None" = None  # of the fitted objects
    network_digest: "Callable[[SemanticModelConfiguration], str] | None" = None  # of the network fitted to, or ""
    semantics: str = "independent_views"  # used where headings come from a map or an enumerated class
    carried: str | None = "class_tables"  # used where headings are unknown; None: not supported there
    has_factors: bool = True  # views become graph factors when hypotheses enumerate classes
    repeats_errors: bool = True  # errors repeat between views, so likelihoods are tempered

    @property
    def sees_places_alone(self) -> bool:
        """Whether views are independent of the object's heading."""
        return self.viewpoint is None and self.descriptors is None


NONE = ClassModelKind(semantics="none", carried="none", has_factors=False, repeats_errors=False)
"""No class models: geometry alone."""


def class_model_kind(settings: "SemanticModelConfiguration") -> ClassModelKind:
    """The configured kind. Raises InputError."""
    kind = CLASS_MODELS.load(settings.kind)
    if not isinstance(kind, ClassModelKind):
        raise InputError(
            f"class model '{settings.kind}' is a {type(kind).__name__}; announce a"
            " semantic_slam.class_models.kind.ClassModelKind"
        )
    return kind

"""Kinds of class models: what a value of ``semantic_model.kind`` stands for, of this package or of a foreign one."""

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
    """What loads the models, and which semantics (names in the registry ``SEMANTICS``) their views go with.

    A fitted viewpoint model needs ``viewpoint`` alone. The loaders take the group ``semantic_model`` of a configuration
    and raise InputError.
    """

    viewpoint: "Callable[[SemanticModelConfiguration], ViewpointModel] | None" = None  # P(z | c, viewpoint)
    descriptors: "Callable[[SemanticModelConfiguration], DescriptorModel] | None" = None  # P(f | viewpoint, e) instead
    labels: "Callable[[SemanticModelConfiguration, str], LabelModel] | None" = (
        None  # a detector's words instead; the text is the digest of the run's bag, "" where there is none
    )
    embeddings: "Callable[[SemanticModelConfiguration], EmbeddingModel] | None" = None  # vectors of appearance instead
    extractor: "Callable[[SemanticModelConfiguration], FeatureExtractor] | None" = None  # f, None: class probabilities
    appearance: "Callable[[SemanticModelConfiguration], KnownAppearance | None] | None" = (
        None  # of what it was fitted to
    )
    semantics: str = "independent_views"  # where a map, or a class that is enumerated, tells how objects are turned
    carried: str | None = "class_tables"  # where nothing tells that; None: the models do not go with such associations
    has_factors: bool = True  # views enter the graphs under classes that hypotheses enumerate
    repeats_errors: bool = True  # view after view meets the same error, for which the likelihoods are tempered

    @property
    def sees_places_alone(self) -> bool:
        """Whether nothing that a view shows depends on how its object is turned."""
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

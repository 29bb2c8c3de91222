"""Loading of the configured latent space: its model for inference and its feature extractor."""

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from semantic_slam.class_models.kind import ClassModelKind, class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.interrupts import import_interruptibly
from semantic_slam.latent.model import DescriptorModel

if TYPE_CHECKING:
    from semantic_slam.perception.collaborators import FeatureExtractor

SHIPPED_MODEL = "latent_model.safetensors"


def load_latent_model(settings: SemanticModelConfiguration) -> DescriptorModel | None:
    """Load the latent model, or None where objects have no descriptors. Raises InputError."""
    load = class_model_kind(settings).descriptors
    return load(settings) if load is not None else None


def load_extractor(settings: SemanticModelConfiguration) -> "FeatureExtractor | None":
    """Load the feature extractor f_psi, or None where class probabilities are the feature. Raises InputError."""
    load = class_model_kind(settings).extractor
    return load(settings) if load is not None else None


def latent_file(settings: SemanticModelConfiguration) -> Path:
    """Path of the configured file, or of the one shipped with the package."""
    return Path(settings.path) if settings.path else Path(str(resources.files("semantic_slam.weights") / SHIPPED_MODEL))


def _model(settings: SemanticModelConfiguration) -> DescriptorModel:
    from semantic_slam.latent.store import read_latent_model

    path = latent_file(settings)
    model = read_latent_model(path)
    if settings.space not in ("", model.space):
        raise InputError(
            f"{path}: holds the latent space {model.space}, wanted is {settings.space}; name the file of that space in"
            " semantic_model.path"
        )
    return model


def _extractor(settings: SemanticModelConfiguration) -> "FeatureExtractor":
    import_interruptibly("torch")
    from semantic_slam.latent.extractor_store import read_extractor

    return read_extractor(latent_file(settings))


LATENT = ClassModelKind(
    descriptors=_model,
    extractor=_extractor,
    semantics="descriptor_views",
    carried="descriptor_tables",
    has_factors=False,
)

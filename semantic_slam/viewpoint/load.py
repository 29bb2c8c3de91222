"""The configured class models."""

from importlib import resources
from pathlib import Path

from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.parametric import ParametricModel
from semantic_slam.viewpoint.store import read_model

SHIPPED_MODELS = "viewpoint_models.safetensors"


def load_model(configuration: SemanticModelConfiguration) -> ViewpointModel | None:
    """The models of Eq. 4.2, or None where there are no classes (``none``, ``latent``). Raises InputError."""
    if configuration.kind in ("none", "latent"):
        return None
    if configuration.kind == "parametric":
        return _parametric(configuration)
    return read_model(Path(configuration.path) if configuration.path else shipped_models())


def shipped_models() -> Path:
    """The viewpoint models that are installed with the package."""
    return Path(str(resources.files("semantic_slam.weights") / SHIPPED_MODELS))


def _parametric(configuration: SemanticModelConfiguration) -> ParametricModel:
    names = configuration.class_names
    if len(names) != 2:
        raise InputError(
            f"semantic_model.class_names: the parametric model has two classes, not {len(names)}; name two"
        )
    return ParametricModel(configuration.alpha, configuration.concentration, names)

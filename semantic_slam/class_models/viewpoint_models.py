"""Loading of the configured viewpoint models."""

from importlib import resources
from pathlib import Path

from semantic_slam.class_models.kind import ClassModelKind, class_model_kind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.viewpoint.appearance import KnownAppearance
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.parametric import ParametricModel
from semantic_slam.viewpoint.store import FittedModel, read_appearance, read_model, read_network_digest

SHIPPED_MODELS = "viewpoint_models.safetensors"


def load_model(settings: SemanticModelConfiguration) -> ViewpointModel | None:
    """Load the viewpoint models of Eq. 4.2, or None where there are none (or descriptors). Raises InputError."""
    load = class_model_kind(settings).viewpoint
    return load(settings) if load is not None else None


def load_appearance(settings: SemanticModelConfiguration) -> KnownAppearance | None:
    """Load the appearance of the fitted objects, or None where the models have none. Raises InputError."""
    load = class_model_kind(settings).appearance
    return load(settings) if load is not None else None


def load_network_digest(settings: SemanticModelConfiguration) -> str:
    """Digest of the network that the models were fitted to; "" where they name none. Raises InputError."""
    load = class_model_kind(settings).network_digest
    return load(settings) if load is not None else ""


def shipped_models() -> Path:
    """Path of the viewpoint models shipped with the package."""
    return Path(str(resources.files("semantic_slam.weights") / SHIPPED_MODELS))


def _parametric(settings: SemanticModelConfiguration) -> ParametricModel:
    names = settings.class_names
    if len(names) != 2:
        raise InputError(
            f"semantic_model.class_names: the parametric model has two classes, not {len(names)}; name two"
        )
    return ParametricModel(settings.alpha, settings.concentration, names)


def _gaussian_process(settings: SemanticModelConfiguration) -> FittedModel:
    return read_model(_file(settings))


def _of_one_height(settings: SemanticModelConfiguration) -> GaussianProcessModel:
    model = read_model(_file(settings))
    if not isinstance(model, GaussianProcessModel):
        raise InputError(
            f"{_file(settings)}: tells heights apart, which semantic_model.kind: gp_correlated does not yet; set kind:"
            " gp_independent, or fit without --elevation-step-deg"
        )
    return model


def _appearance(settings: SemanticModelConfiguration) -> KnownAppearance | None:
    return read_appearance(_file(settings))


def _network_digest(settings: SemanticModelConfiguration) -> str:
    return read_network_digest(_file(settings))


def _file(settings: SemanticModelConfiguration) -> Path:
    return Path(settings.path) if settings.path else shipped_models()


PARAMETRIC = ClassModelKind(viewpoint=_parametric, repeats_errors=False)  # exact by definition
GP_INDEPENDENT = ClassModelKind(viewpoint=_gaussian_process, appearance=_appearance, network_digest=_network_digest)
GP_CORRELATED = ClassModelKind(
    viewpoint=_of_one_height,
    appearance=_appearance,
    network_digest=_network_digest,
    semantics="correlated_views",
    carried=None,
    has_factors=False,
    repeats_errors=False,
)

"""Refuses class models that were fitted to the scores of another network than the configured one."""

from typing import TYPE_CHECKING

from semantic_slam.class_models.viewpoint_models import load_model, load_network_digest
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError, shortened
from semantic_slam.viewpoint.store import FittedModel

if TYPE_CHECKING:
    from semantic_slam.perception.networks.network import ClassifierNetwork

REMEDY = "fit models to it with semantic_slam fit --config, or set semantic_model.kind: none"


class OtherScoresError(InputError):
    """Raised for class models that were fitted to scores of other names than the configured network's."""


def check_fitted_to(network: "ClassifierNetwork", settings: SemanticModelConfiguration) -> None:
    """Compare names of the scores, and weights where the file of the class models states a digest.

    Raises OtherScoresError for other names and InputError for other weights. Class models that are not read from such a
    file are not checked.
    """
    model = load_model(settings)
    if not isinstance(model, FittedModel):
        return
    if model.feature_names != network.class_names:
        raise OtherScoresError(
            f"{models_of(settings)}: fitted to the scores of {shortened(model.feature_names)}, but the configured"
            f" network has scores of {shortened(network.class_names)}; {REMEDY}"
        )
    from semantic_slam.perception.networks.digest import network_digest

    digest = load_network_digest(settings)
    if digest and digest != network_digest(network):
        raise other_network(settings)


def other_network(settings: SemanticModelConfiguration) -> InputError:
    """The error of class models whose scores have the right names but come from other weights or groups."""
    return InputError(
        f"{models_of(settings)}: fitted to another network, or to other groups of classes, than the configured one;"
        f" {REMEDY}"
    )


def models_of(settings: SemanticModelConfiguration) -> str:
    """How an error names the file of the class models."""
    return settings.path or "shipped class models"

"""Builds the classifier of a configuration: network, feature extractor, class models and geometry."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.class_models.latent_space import load_extractor
from semantic_slam.class_models.viewpoint_models import load_appearance, load_model
from semantic_slam.configuration import Configuration, PerceptionConfiguration, SemanticModelConfiguration
from semantic_slam.interrupts import import_interruptibly
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.collaborators import AppearanceCheck, CoverageCheck
from semantic_slam.perception.range_bearing import range_and_bearing
from semantic_slam.pipeline.fitted_network import OtherScoresError, check_fitted_to, other_network
from semantic_slam.viewpoint.appearance import KnownPictures
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.novelty import KnownViews

if TYPE_CHECKING:
    from semantic_slam.perception.networks.network import ClassifierNetwork


def build_classifier(configuration: Configuration, warn: Callable[[str], None] | None = None) -> Classifier:
    """Load the network and the class models.

    ``warn`` is told where the models are for scores of other names, which then go without a novelty check; None:
    OtherScoresError is raised. Raises InputError if files are missing or invalid, or the models for other weights.
    """
    settings, semantic_model = configuration.perception, configuration.semantic_model
    network, extractor = _network(configuration), load_extractor(semantic_model)
    appearance = None
    try:
        if network is not None and extractor is None:
            check_fitted_to(network, semantic_model)
        appearance = _appearance(semantic_model, settings, network)
    except OtherScoresError as fault:
        if warn is None:
            raise
        warn(str(fault))
    num_features = len(network.class_names) if network is not None else 0
    if extractor is not None:
        num_features = extractor.num_features
    return Classifier(
        network,
        settings,
        seed=configuration.seed,
        range_bearing_sensor=partial(range_and_bearing, configuration=settings),
        extractor=extractor,
        coverage=_coverage(semantic_model, num_features),
        appearance=appearance,
        in_space=configuration.is_spatial,
    )


def _network(configuration: Configuration) -> "ClassifierNetwork | None":
    """The network; None if the detector's own labels or embeddings are the evidence. Raises InputError."""
    kind = class_model_kind(configuration.semantic_model)
    if kind.labels is not None or kind.embeddings is not None:
        return None
    import_interruptibly("torch")
    from semantic_slam.perception.networks.weights import load_network

    return load_network(configuration.perception)


def _appearance(
    settings: SemanticModelConfiguration, perception: PerceptionConfiguration, network: "ClassifierNetwork | None"
) -> AppearanceCheck | None:
    """Novelty check of image crops; None if the models have none. Raises InputError for models of another network."""
    known = load_appearance(settings) if network is not None and perception.novelty_false_alarms else None
    if network is None or known is None:
        return None
    from semantic_slam.perception.networks.mc_dropout import probe_features

    if not known.is_about(probe_features(network.network)):
        raise other_network(settings)
    return KnownPictures(known, perception.novelty_false_alarms)


def _coverage(settings: SemanticModelConfiguration, num_features: int) -> CoverageCheck | None:
    """Viewpoint coverage check; None if the class models are not fitted, or to another feature than is measured."""
    model = load_model(settings)
    if not isinstance(model, GaussianProcessModel) or model.num_features != num_features:
        return None
    return KnownViews(model)

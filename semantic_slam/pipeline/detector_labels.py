"""Labels of a detector: those of a bag, or of the first detections of a live run."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.class_models.detector import fitted_labels
from semantic_slam.class_models.embedding import fitted_vectors
from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages.codec import from_message
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.viewpoint.labels.model import NONE_OF_THESE

OF_ANYTHING = frozenset({"", "object"})
"""Labels of class-agnostic detectors."""


def labels_of(told: Detections | SemanticMeasurements) -> frozenset[str]:
    """Labels in a message: those of its detections, and the classes for which its detector gives scores."""
    is_classified = isinstance(told, SemanticMeasurements) and told.class_probability_samples.shape[1] > 0
    classes = () if is_classified else told.class_names  # if classified, they are those of our own network
    return frozenset((*told.labels, *classes)) - {""}


def labels_in(reader: BagReader, topic: str) -> frozenset[str]:
    """Labels of all detections or measurements of a bag; messages that do not decode are skipped."""
    return frozenset[str]().union(*map(labels_of, _told(reader, topic)))


def scored_classes_in(reader: BagReader, topic: str) -> frozenset[str] | None:
    """Classes for which the first detections of a bag have scores; messages that do not decode are skipped.

    None where nothing was detected.
    """
    return next((frozenset(told.class_names) for told in _told(reader, topic) if len(told)), None)


def _told(reader: BagReader, topic: str) -> Iterator[Detections | SemanticMeasurements]:
    """Messages of a topic of detections or measurements that decode."""
    try:
        for message in reader.messages([topic]):
            try:
                yield from_message(reader.decode(message.cdr, message.type_name))
            except InputError:
                continue  # the run counts it
    except TruncatedBagError:
        pass  # the run reports the damage


def are_asked_for(configuration: Configuration) -> bool:
    """Whether the configured class models use labels."""
    kind = class_model_kind(configuration.semantic_model)
    return kind.labels is not None or not kind.sees_places_alone


def known_to_fit(settings: SemanticModelConfiguration, sha256: str) -> str:
    """Notice if the configured models were fitted to the bag with this SHA-256, else "". Raises InputError."""
    labels, vectors = fitted_labels(settings), fitted_vectors(settings)
    ways = []
    if labels is not None and labels.bag(sha256) is not None:
        ways.append("every stretch of it has the models that were fitted without it")
    if vectors is not None and sha256 in vectors.without:
        ways.append("its vectors have the models that were fitted without this bag")
    return f"{settings.path} was fitted to this bag, too; {', and '.join(ways)}" if ways else ""


def with_labels(
    configuration: Configuration,
    measurements: SemanticMeasurements,
    prior: MapPrior | None,
    labels: Iterable[str] = (),
) -> Configuration:
    """The configuration with the labels that objects may have, if it does not list them itself.

    ``measurements`` are the first of the run, ``labels`` those of all detections as far as known. The classes of the
    map prior and those of fitted models are added. Raises InputError for labels that are no class of the network's
    class models.
    """
    settings, named = configuration.semantic_model, {*labels, *labels_of(measurements)}
    if class_model_kind(settings).labels is not None:
        known = known_labels(configuration, named, prior)
        return replace(configuration, semantic_model=replace(settings, labels=known))
    told = sorted(_wanted(configuration, named))
    if measurements.class_probability_samples.shape[1] > 0:
        check_meant(configuration, told)
    return configuration


def known_labels(configuration: Configuration, named: Iterable[str], prior: MapPrior | None) -> tuple[str, ...]:
    """Possible labels of objects: those configured, else those of detections (``named``), map and fitted models."""
    settings = configuration.semantic_model
    mapped = classes_in(prior) if prior is not None else frozenset()
    fitted = fitted_labels(settings)
    learned = fitted.labels if fitted is not None else ()
    known = {*_wanted(configuration, named), *mapped, *learned} - {NONE_OF_THESE}
    return settings.labels or tuple(sorted(known))


def classes_in(prior: MapPrior) -> frozenset[str]:
    """Classes that a map's objects may have; what no label means is none of them."""
    return frozenset(name for item in prior.objects for name in item.class_probabilities) - {NONE_OF_THESE}


def _wanted(configuration: Configuration, named: Iterable[str]) -> set[str]:
    wanted = configuration.perception.labels
    return {label for label in named if not wanted or label in wanted}


def check_meant(configuration: Configuration, labels: list[str]) -> None:
    """Raises InputError for a label that is no class of the models; a network would assign one of its classes to it."""
    settings = configuration.semantic_model
    names = class_names_of(settings)
    strange = [label for label in labels if not is_meant(label, names)]
    if strange:
        raise InputError(
            f"detections are labelled '{strange[0]}', which is none of the classes of semantic_model.kind:"
            f" {settings.kind} ({', '.join(names)}); set semantic_model.kind: detector to go by the"
            " detector's labels (config/detector.yaml), or leave out such detections with perception.labels, or rename"
            " them with import_dataset bag --labels"
        )


def class_names_of(settings: SemanticModelConfiguration) -> tuple[str, ...]:
    """Classes of a network's class models; () where there are no such models. Raises InputError."""
    model = load_model(settings) or load_latent_model(settings)
    return tuple(model.class_names) if model is not None else ()


def is_meant(label: str, class_names: tuple[str, ...]) -> bool:
    """Whether a label may be of an object of these classes: one of them or of anything; any label, where none are."""
    return not class_names or label in class_names or label in OF_ANYTHING

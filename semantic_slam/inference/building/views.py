"""How semantic views of objects enter inference: by which semantics, and as factors or as records of the objects."""

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import strategy_of


def semantics_name(configuration: Configuration) -> str:
    """Name of the semantics for the class models; it depends on whether views are factors. Raises InputError."""
    kind = class_model_kind(configuration.semantic_model)
    if not _defers_view_factors(configuration):
        return kind.semantics
    if kind.carried is None:
        raise InputError(
            f"association: {configuration.association} has no {configuration.semantic_model.kind} class models;"
            " set semantic_model.kind: gp_independent"
        )
    return kind.carried


def views_are_factors(configuration: Configuration) -> bool:
    """Whether semantic measurements enter the graphs as factors, given classes that hypotheses enumerate."""
    return class_model_kind(configuration.semantic_model).has_factors and not _defers_view_factors(configuration)


def sees_places_in_single_steps(configuration: Configuration) -> bool:
    """Whether updates are single steps (not iterated), and views carry no information on an object's heading."""
    kind = class_model_kind(configuration.semantic_model)
    return kind.sees_places_alone and not configuration.open_world.iterate_updates


def tempering(settings: SemanticModelConfiguration) -> float:
    """Tempering of view likelihoods: the number of views that carry as much information as one independent view."""
    return settings.likelihood_tempering if class_model_kind(settings).repeats_errors else 1.0


def _defers_view_factors(configuration: Configuration) -> bool:
    """Whether views are kept in the objects' records, not as factors, until the objects' headings are known."""
    association = strategy_of(configuration)
    enumerates = configuration.open_world.classes == "enumerated"
    has_factors = class_model_kind(configuration.semantic_model).has_factors
    return association.defers_view_factors and not (has_factors and enumerates)

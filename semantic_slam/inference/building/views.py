"""How views of objects enter: which semantics weigh them, and whether by factors or carried with their objects."""

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import strategy_of


def semantics_name(configuration: Configuration) -> str:
    """Semantics that suit the class models, and whether headings are known before views enter. Raises InputError."""
    kind = class_model_kind(configuration.semantic_model)
    if not _carries_views(configuration):
        return kind.semantics
    if kind.carried is None:
        raise InputError(
            f"association: {configuration.association} has no {configuration.semantic_model.kind} class models;"
            " set semantic_model.kind: gp_independent"
        )
    return kind.carried


def views_are_factors(configuration: Configuration) -> bool:
    """Whether semantic measurements enter by factors, under classes that hypotheses enumerate."""
    return class_model_kind(configuration.semantic_model).has_factors and not _carries_views(configuration)


def sees_places_in_single_steps(configuration: Configuration) -> bool:
    """Whether updates are not iterated, and no view tells how its object is turned."""
    kind = class_model_kind(configuration.semantic_model)
    return kind.sees_places_alone and not configuration.open_world.iterate_updates


def tempering(settings: SemanticModelConfiguration) -> float:
    """So many views tell as much as one."""
    return settings.likelihood_tempering if class_model_kind(settings).repeats_errors else 1.0


def _carries_views(configuration: Configuration) -> bool:
    """Whether views stay with the objects of a hypothesis until it is known how these are turned."""
    association = strategy_of(configuration)
    enumerates = configuration.open_world.classes == "enumerated"
    has_factors = class_model_kind(configuration.semantic_model).has_factors
    return association.carries_views and not (has_factors and enumerates)

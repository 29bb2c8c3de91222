"""What does not work in space yet. Every check raises InputError."""

from collections.abc import Iterator

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.models.moving import Moving


def check_space(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    """Raises InputError for the first setting that only a planar run has."""
    if not configuration.is_spatial:
        return
    for is_set, remedy in _planar_alone(configuration, association):
        if is_set:
            raise InputError(f"state_space: spatial does not go with that yet; {remedy}, or state_space: planar")


def _planar_alone(configuration: Configuration, association: type[AssociationStrategy]) -> Iterator[tuple[bool, str]]:
    """Whether a run would need what there is in the plane alone, and what to set in its place."""
    world = configuration.closed_world
    yield (
        association.tracks_objects,
        "set association: enumerated with a map prior, or given with open_world.iterate_updates: true",
    )
    yield configuration.semantic_model.kind != "none", "set semantic_model.kind: none"
    yield configuration.observation == "range_bearing", "set observation: points"
    yield Moving(configuration.moving).is_on, "set moving.share: 0 and moving.share_by_label: []"
    yield world.unmapped_objects > 0, "set closed_world.unmapped_objects: 0"
    yield world.displaced_share > 0.0, "set closed_world.displaced_share: 0"
    yield configuration.history.is_on, "set history.horizon_keyframes: 0"

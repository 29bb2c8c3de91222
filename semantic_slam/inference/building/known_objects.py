"""The objects of a run before its first keyframe: mapped ones, placeholders of unmapped ones, and displaced twins."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.building.class_prior import class_prior
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.states.gaussian import JointPrior, TwinPrior
from semantic_slam.inference.world.displaced_objects import Displaced, with_displaced
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior, parse_map_prior
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.sensing import PriorReader, Sensing
from semantic_slam.inference.world.unmapped import unmapped_objects


@dataclass(frozen=True, kw_only=True)
class KnownObjects:
    """The objects that a run starts with."""

    prior: MapPrior  # including placeholders for unmapped objects, and displaced twins
    entries: tuple[ObjectEntry, ...]
    joint: JointPrior | None  # None: their priors are independent
    unmapped_ids: frozenset[int]
    displaced: Displaced


def known_objects(
    run: RunConfiguration, configuration: Configuration, sensing: Sensing, *, may_lack: bool
) -> KnownObjects:
    """The objects of the run's map prior, none where it has none; with placeholders and displaced twins as configured.

    ``may_lack``: the map may lack objects, for which there are placeholders. Raises InputError for a map that does not
    go with the run.
    """
    prior = parse_map_prior(run.map_prior, "map prior") if run.map_prior else MapPrior()
    unmapped = _unmapped(configuration, prior) if may_lack else ()
    prior, displaced = _with_displaced(configuration, prior, unmapped)
    prior = replace(prior, objects=(*prior.objects, *unmapped))
    remedy = _remedy(configuration)
    return KnownObjects(
        prior=prior,
        entries=tuple(_entry(item, run.class_names, sensing.object_prior, remedy) for item in prior.objects),
        joint=_joint(prior, displaced, sensing),
        unmapped_ids=frozenset(item.object_id for item in unmapped),
        displaced=displaced,
    )


def _is_associated_with_map(configuration: Configuration) -> bool:
    """Whether the world is closed: detections are of the map's objects or clutter, and no object is born."""
    association = strategy_of(configuration)
    return association.needs_map and not association.tracks_objects


def _unmapped(configuration: Configuration, prior: MapPrior) -> tuple[ObjectPrior, ...]:
    """Placeholders for objects that the map may lack, in a closed world with clutter."""
    settings = configuration.closed_world
    if not _is_associated_with_map(configuration) or settings.clutter_per_frame <= 0.0:
        return ()
    reach, heading = configuration.open_world.max_range_m, configuration.new_objects.sigma_heading_rad
    return unmapped_objects(prior, settings.unmapped_objects, settings.unmapped_probability, reach, heading)


def _with_displaced(
    configuration: Configuration, prior: MapPrior, unmapped: Sequence[ObjectPrior]
) -> tuple[MapPrior, Displaced]:
    """The map with displaced twins of its objects, in a closed world; unchanged without objects."""
    settings = configuration.closed_world
    if strategy_of(configuration).tracks_objects or not prior.objects:
        return prior, Displaced()
    first = 1 + max(item.object_id for item in (*prior.objects, *unmapped))
    return with_displaced(prior, settings.displaced_share, settings.displaced_sigma_m, first)


def _remedy(configuration: Configuration) -> str:
    """What to do about a map with classes that the class models do not know."""
    if class_model_kind(configuration.semantic_model).labels is not None:
        return "add it to semantic_model.labels, or empty that list"
    return (
        "a map of a detector's labels needs semantic_model.kind: detector, as config/detector_second_session.yaml has"
        " it, and only its places are used with semantic_model.kind: none"
    )


def _entry(item: ObjectPrior, class_names: tuple[str, ...], prior: PriorReader, remedy: str) -> ObjectEntry:
    """The registry's entry of a mapped object.

    Raises InputError, with the remedy, for a class that the class models do not know.
    """
    unknown = sorted(set(item.class_probabilities) - set(class_names))
    if unknown and class_names:
        raise InputError(
            f"map prior: object {item.object_id} has the unknown class '{unknown[0]}'; the class models know"
            f" {', '.join(class_names)}; {remedy}"
        )
    return ObjectEntry(
        object_id=item.object_id,
        name=item.name,
        prior=prior(item.pose, item.covariance),
        class_prior=class_prior(item, class_names),
        existence=item.existence,
    )


def _joint(prior: MapPrior, displaced: Displaced, sensing: Sensing) -> JointPrior | None:
    """Joint prior of the mapped objects and of their twins, if the map states one; placeholders are not in it."""
    if prior.joint_covariance is None or len(prior.joint_covariance) <= 3:
        return None
    if prior.state_space != sensing.spaces.name:
        raise InputError(
            f"map prior: a map of state_space: {prior.state_space}, and the run is {sensing.spaces.name}; set"
            " state_space, or give a map of such a run"
        )
    mapped = prior.objects[: len(prior.joint_covariance) // 3]
    poses = np.array([item.pose for item in mapped])
    joint = sensing.joint_prior(poses, prior.joint_covariance)
    twins = tuple(
        TwinPrior(other, item.object_id, sensing.object_prior(item.pose, displaced.covariance).covariance)
        for item in mapped
        if (other := displaced.elsewhere.get(item.object_id)) is not None
    )
    return JointPrior(tuple(item.object_id for item in mapped), joint, twins)

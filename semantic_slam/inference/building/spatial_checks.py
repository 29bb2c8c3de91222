"""Checks for settings that do not work in space (SE(3)) yet. Every check raises InputError."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.building.views import views_are_factors
from semantic_slam.inference.models.moving import Moving
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.spherical_process import SphericalProcessModel


def check_space(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    """Raise InputError for the first setting that works only in the plane; for a planar run, only in space."""
    if not configuration.is_spatial:
        if configuration.odometry.sigma_level_rad > 0.0:
            raise InputError("odometry.sigma_level_rad: a planar robot is level; set it to 0, or state_space: spatial")
        if configuration.open_world.region_by_camera:
            raise InputError("open_world.region_by_camera: needs state_space: spatial; set it to false, or that")
        return
    for is_set, remedy in _planar_alone(configuration, association):
        if is_set:
            raise InputError(f"state_space: spatial does not go with that yet; {remedy}, or state_space: planar")


def check_fitted(configuration: Configuration) -> None:
    """Raise InputError if fitted models complete a run in space with detection rates that it does not have yet."""
    if configuration.is_spatial and configuration.open_world.detection_by_direction:
        raise InputError(
            f"semantic_model.path: {configuration.semantic_model.path} tells detection rates by direction, which"
            " state_space: spatial does not have yet; list your detector's in open_world.detection_probabilities, which"
            " leaves out the fitted ones, or fit runs in space alone"
        )


def check_heights(configuration: Configuration, model: ViewpointModel | None) -> None:
    """Raise InputError for class models over azimuth and elevation in the plane, where every elevation counts as 0."""
    if isinstance(model, SphericalProcessModel) and not configuration.is_spatial:
        raise InputError(
            f"semantic_model.path: {configuration.semantic_model.path} tells heights apart, which needs state_space:"
            " spatial; set that, or fit without --elevation-step-deg"
        )


def _planar_alone(configuration: Configuration, association: type[AssociationStrategy]) -> Iterator[tuple[bool, str]]:
    """Yield, for each planar-only feature, whether it is configured, and what to set instead."""
    closed, world = configuration.closed_world, configuration.open_world
    errors, perception, revision = configuration.detection_errors, configuration.perception, configuration.revision
    yield (
        association.tracks_objects and not world.iterate_updates,
        "set open_world.iterate_updates: true",
    )
    kind = class_model_kind(configuration.semantic_model)
    yield (
        kind.descriptors is not None and not association.tracks_objects,
        "set association: open, or semantic_model.kind: none, detector, or one of viewpoints",
    )
    yield (
        configuration.observation == "points" and not kind.sees_places_alone,
        "set observation: range_bearing, or semantic_model.kind: none, detector or embedding",
    )
    yield (
        association.tracks_objects and views_are_factors(configuration),
        "set open_world.classes: carried, or association: enumerated, or given",
    )
    yield Moving(configuration.moving).is_on, "set moving.share: 0 and moving.share_by_label: []"
    yield closed.unmapped_objects > 0, "set closed_world.unmapped_objects: 0"
    yield closed.displaced_share > 0.0, "set closed_world.displaced_share: 0"
    yield revision.carried_probability > 0.0, "set revision.carried_probability: 0"
    yield configuration.odometry.slip_share > 0.0, "set odometry.slip_share: 0"
    if not association.tracks_objects:
        return
    yield revision.lost_every_keyframes > 0, "set revision.lost_every_keyframes: 0"
    yield errors.correlated_share > 0.0, "set detection_errors.correlated_share: 0"
    yield perception.sigma_range_scale > 0.0, "set perception.sigma_range_scale: 0"
    yield world.learn_region, "set open_world.learn_region: false"
    yield world.learn_scores, "set open_world.learn_scores: false"
    yield world.direction_rad != 0.0, "set open_world.direction_rad: 0 and tell where the camera looks"
    yield len(world.detection_by_direction) > 0, "set open_world.detection_by_direction: []"
    yield world.field_of_view_rad >= np.pi, "set open_world.field_of_view_rad below half a turn"

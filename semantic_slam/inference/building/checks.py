"""Checks for settings that do not go with a run's association or class models. Every check raises InputError."""

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.building.association_settings import moving_of
from semantic_slam.inference.building.horizon_check import check_horizon
from semantic_slam.inference.building.spatial_checks import check_space
from semantic_slam.inference.building.views import sees_places_in_single_steps, semantics_name
from semantic_slam.inference.models.noise.noise_settings import DEPTH, DISTANCE
from semantic_slam.inference.world.departures import Departures

KINDS_OF_PLACES = "semantic_model.kind: none, detector, embedding or detector_embedding"
"""What errors call the kinds whose views are independent of an object's heading."""
SHORTEST_HALF_RANGE_M = 1e-3  # shorter ones would be of no sensor, and their squares underflow


def check_settings(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    """Raises InputError for the first setting that does not go with the others."""
    check_space(configuration, association)
    association.check(configuration)
    semantics_name(configuration)
    _check_odometry(configuration, association)
    _check_detection_errors(configuration, association)
    _check_detections(configuration, association)
    _check_rates(configuration)
    _check_revision(configuration, association)
    _check_moving(configuration, association)
    _check_displaced(configuration, association)
    _check_existence(configuration)
    _check_pruning(configuration)
    check_horizon(configuration)


def _check_odometry(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    factors, tracks = configuration.odometry.noise_factors, association.tracks_objects
    if not factors or min(factors) <= 0.0 or (factors != (1.0,) and not tracks):
        raise InputError(
            "odometry.noise_factors must be positive, and other than [1.0] only with association: open, or given with"
            " open_world.iterate_updates: false"
        )
    if configuration.odometry.slip_share > 0.0 and not tracks:
        raise InputError(
            "odometry.slip_share is for association: open, or given with open_world.iterate_updates: false; set these,"
            " or it to 0"
        )
    single_steps = tracks and not configuration.open_world.iterate_updates
    if configuration.odometry.estimate_bias and not single_steps:
        raise InputError(
            "odometry.estimate_bias works only where updates are not iterated;"
            " set association: open, or given, and open_world.iterate_updates: false"
        )


def _check_detection_errors(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    errors = configuration.detection_errors
    single_steps = association.tracks_objects and not configuration.open_world.iterate_updates
    if errors.correlated_share > 0.0 and not single_steps:
        raise InputError(
            "detection_errors.correlated_share works only where updates are not iterated;"
            " set association: open, or given, and open_world.iterate_updates: false"
        )
    if errors.correlated_shares and (
        errors.correlated_share <= 0.0 or not all(0.0 < own <= 0.99 for own in errors.correlated_shares)
    ):
        raise InputError(
            "detection_errors.correlated_shares must be above 0 and at most 0.99, and correlated_share above 0, too;"
            " correct them, or empty it"
        )
    if errors.outlier_share > 0.0 and not (association.tracks_objects and sees_places_in_single_steps(configuration)):
        raise InputError(
            "detection_errors.outlier_share works only with association: open or given, open_world.iterate_updates:"
            f" false and {KINDS_OF_PLACES}; set these, or it to 0"
        )
    if (errors.sigma_range_offset_m or errors.sigma_yaw_rad) and errors.correlated_share <= 0.0:
        raise InputError(
            "detection_errors.sigma_range_offset_m and sigma_yaw_rad need detection_errors.correlated_share above 0;"
            " set it, or both of them to 0"
        )


def _check_detections(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    factors = configuration.perception.noise_factors
    may_differ = association.tracks_objects and sees_places_in_single_steps(configuration)
    if not factors or min(factors) <= 0.0 or (factors != (1.0,) and not may_differ):
        raise InputError(
            "perception.noise_factors must be positive, and other than [1.0] only with association: open or given,"
            f" open_world.iterate_updates: false and {KINDS_OF_PLACES}"
        )
    kinds = configuration.perception.ranges_are
    if not kinds or not {DISTANCE, DEPTH}.issuperset(kinds) or (kinds != (DISTANCE,) and not may_differ):
        raise InputError(
            "perception.ranges_are must be distance, depth or both, and other than [distance] only where"
            " perception.noise_factors may be"
        )


def _check_rates(configuration: Configuration) -> None:
    """Check the grids of detection, miss, birth and clutter rates between which evidence is to decide."""
    world = configuration.open_world
    if not all(0.0 < own < 1.0 for own in world.detection_probabilities):
        raise InputError("open_world.detection_probabilities must lie between 0 and 1; correct them")
    if not min(world.detection_half_ranges_m, default=SHORTEST_HALF_RANGE_M) >= SHORTEST_HALF_RANGE_M:
        raise InputError(f"open_world.detection_half_ranges_m must be at least {SHORTEST_HALF_RANGE_M} m; correct them")
    if len(world.detection_by_direction) == 1 or not all(0.0 < own <= 1.0 for own in world.detection_by_direction):
        raise InputError(
            "open_world.detection_by_direction must be two shares or more, above 0 and at most 1; correct it"
        )
    if world.detection_by_direction and world.learn_region:
        raise InputError(
            "open_world.detection_by_direction is over a field of view; empty it, or set learn_region: false"
        )
    if not all(0.0 <= own < 1.0 for own in world.miss_persistences):
        raise InputError("open_world.miss_persistences must not be below 0, and be below 1; correct them")
    if min(world.clutters_per_frame, default=0.0) < 0.0:
        raise InputError("open_world.clutters_per_frame must not be below 0; correct them")
    if min(world.birth_densities, default=1.0) <= 0.0:
        raise InputError("open_world.birth_densities must be above 0; correct them")


def _check_revision(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    revision, tracks = configuration.revision, association.tracks_objects
    if revision.every_keyframes > 0 and not tracks and not configuration.is_spatial:  # config/spatial.yaml serves maps
        raise InputError(
            "revision.every_keyframes is for worlds without a map; set association: open, or set it to 0 (given with"
            " open_world.iterate_updates: false has nothing to revise)"
        )
    if revision.reassociate_every_keyframes > 0 and not tracks:
        raise InputError("revision.reassociate_every_keyframes is for association: open; set that, or set it to 0")
    if revision.lost_every_keyframes > 0 and not tracks:
        raise InputError("revision.lost_every_keyframes is for association: open; set that, or set it to 0")


def _check_displaced(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    if configuration.closed_world.displaced_share > 0.0 and association.tracks_objects:
        raise InputError(
            "closed_world.displaced_share is for association: enumerated, or given with open_world.iterate_updates:"
            " true; set these, or it to 0"
        )


def _check_existence(configuration: Configuration) -> None:
    world = configuration.open_world
    if world.learn_scores and world.learn_alarm_scores:
        raise InputError(
            "open_world.learn_scores and learn_alarm_scores would count the same scores twice; set one of them to false"
        )
    _ = Departures(world).by_label  # raises


def _check_pruning(configuration: Configuration) -> None:
    pruning = configuration.pruning
    if pruning.max_pairs > 0 and pruning.place_m <= 0.0:
        raise InputError(
            "pruning.max_pairs is of one place, and needs pruning.place_m above 0; set it, or max_pairs to 0"
        )


def _check_moving(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    moving = moving_of(configuration, association)
    plain = sees_places_in_single_steps(configuration)
    if moving.is_on and association.tracks_objects and not (plain and len(moving.speeds)):
        raise InputError(
            "moving.share and moving.share_by_label are for open_world.iterate_updates: false and"
            f" {KINDS_OF_PLACES}; set these, or the shares to 0"
        )

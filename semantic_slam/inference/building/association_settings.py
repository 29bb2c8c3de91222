"""Settings as an association strategy uses them: revision and miss models, moving objects, and noise hypotheses."""

from dataclasses import replace

from semantic_slam.configuration import Configuration, PruningConfiguration
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings


def as_used(configuration: Configuration, association: type[AssociationStrategy]) -> Configuration:
    """The configuration without settings that do not apply to ``association``.

    With given identities or a closed world (known map) there is nothing to revise; where missed detections do not
    count, their model is cleared.
    """
    revision, world = configuration.revision, configuration.open_world
    if association.wants_identities or not association.tracks_objects:
        revision = replace(revision, every_keyframes=0, second_boxes_every_keyframes=0, lost_every_keyframes=0)
    if configuration.is_spatial:
        revision = replace(revision, second_boxes_every_keyframes=0)
    if not association.counts_misses:
        world = replace(
            world,
            learn_region_within_m=0.0,  # all detections are used then, so that the region has to hold them
            detection_probabilities=(),
            detection_half_ranges_m=(),
            detection_by_direction=(),
            birth_densities=(),
            clutters_per_frame=(),
            miss_persistence=0.0,
            miss_persistences=(),
        )
    return replace(configuration, revision=revision, open_world=world)


def while_lost(configuration: Configuration) -> PruningConfiguration:
    """Pruning limits for a run whose robot is lost at its start (global localisation)."""
    pruning, most = configuration.pruning, configuration.revision.lost_hypotheses
    return replace(pruning, max_hypotheses=min(pruning.max_hypotheses, most)) if most > 0 else pruning


def moving_of(configuration: Configuration, association: type[AssociationStrategy]) -> Moving:
    """The model of moving objects; off where detections carry the identity of their object."""
    if association.wants_identities:
        return Moving()
    return Moving(configuration.moving, configuration.detection_errors)


def noise_settings_of(
    configuration: Configuration, association: type[AssociationStrategy]
) -> tuple[NoiseSettings | None, ...]:
    """Noise settings that root hypotheses try; in a closed world only that of the configuration (None)."""
    return NoiseSettings.grid(configuration) if association.tracks_objects else (None,)

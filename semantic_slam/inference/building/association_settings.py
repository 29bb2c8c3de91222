"""Settings as an association uses them: what counts, what may move, and which noises are tried."""

from dataclasses import replace

from semantic_slam.configuration import Configuration, PruningConfiguration
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings


def as_used(configuration: Configuration, association: type[AssociationStrategy]) -> Configuration:
    """Without what ``association`` has no use for: names and maps leave nothing to revise, and misses may not count."""
    revision, world = configuration.revision, configuration.open_world
    if association.wants_identities or not association.tracks_objects:
        revision = replace(revision, every_keyframes=0, second_boxes_every_keyframes=0, lost_every_keyframes=0)
    if configuration.is_spatial:
        revision = replace(revision, second_boxes_every_keyframes=0)
    if not association.counts_misses:
        world = replace(
            world,
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
    """How much is followed of a robot that is lost when it begins."""
    pruning, most = configuration.pruning, configuration.revision.lost_hypotheses
    return replace(pruning, max_hypotheses=min(pruning.max_hypotheses, most)) if most > 0 else pruning


def moving_of(configuration: Configuration, association: type[AssociationStrategy]) -> Moving:
    """What may move: nothing where detections carry the identity of their object."""
    if association.wants_identities:
        return Moving()
    return Moving(configuration.moving, configuration.detection_errors)


def noises_of(configuration: Configuration, association: type[AssociationStrategy]) -> tuple[NoiseSettings | None, ...]:
    """What hypotheses may take the noises to be; where objects are not tracked, all is as told."""
    return NoiseSettings.grid(configuration) if association.tracks_objects else (None,)

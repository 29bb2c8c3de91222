"""The methods of the study: what each changes in the configuration for a robot that nobody calibrated."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import Configuration, OdometryConfiguration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.models.noise.noise_settings import DISTANCE
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.studies.real_drives.drives import MRCLAM, Drive

OURS, GIVEN, BATCH = "ours", "given", "batch_cauchy"
BASELINES = ("one_hypothesis", "nearest_neighbour", "jcbb")
PLAIN = (OURS, GIVEN, *BASELINES, BATCH)
"""Run without being asked for by name, ours first: it chooses the noise that the others are given."""
WITH_ROBOTS = "with_robots"
"""Ours with the sightings of other robots, where the drive has them."""


def _with_independent_errors(base: Configuration) -> Configuration:
    return replace(base, detection_errors=replace(base.detection_errors, correlated_share=0.0, correlated_shares=()))


def _without_outliers(base: Configuration) -> Configuration:
    return replace(base, detection_errors=replace(base.detection_errors, outlier_share=0.0))


def _with_noise_as_stated(base: Configuration) -> Configuration:
    told = replace(base, odometry=replace(base.odometry, noise_factors=(1.0,), estimate_bias=False))
    told = replace(told, detection_errors=replace(told.detection_errors, correlated_shares=()))
    sensor = replace(told.open_world, detection_probabilities=(), detection_half_ranges_m=())
    world = replace(sensor, birth_densities=(), clutters_per_frame=())
    perception = replace(told.perception, noise_factors=(1.0,), ranges_are=(DISTANCE,))
    return replace(told, open_world=world, perception=perception)


def _without_clusters(base: Configuration) -> Configuration:
    return replace(base, open_world=replace(base.open_world, joint_ranking=False))


def _without_revision(base: Configuration) -> Configuration:
    return replace(base, revision=replace(base.revision, every_keyframes=0))


def _without_motion(base: Configuration) -> Configuration:
    return replace(base, moving=replace(base.moving, share=0.0, share_by_label=()))


ABLATIONS: dict[str, Callable[[Configuration], Configuration] | None] = {
    "without_correlation": _with_independent_errors,
    "without_outliers": _without_outliers,
    "without_estimated_noise": _with_noise_as_stated,
    "without_clusters": _without_clusters,
    "without_revision": _without_revision,
    "without_check": None,
    "without_motion": _without_motion,
}
"""Name -> what switches it off; None where the engine has no such switch."""


@dataclass(frozen=True)
class Chosen:
    """What ours settled on: factors on the covariances of odometry and detections, what ranges are, what repeats."""

    odometry_factor: float = 1.0
    detection_factor: float = 1.0
    ranges_are: str = DISTANCE
    correlated_share: float | None = None  # None: as configured


AS_CONFIGURED = Chosen()
"""Noise as the configuration states it, which is not the same as no choice: ours may choose it, too."""


@dataclass(frozen=True)
class Prepared:
    """What the engine is run with for one method."""

    configuration: Configuration
    odometry_factor: float = 1.0  # by which ``configuration`` scales the covariance of odometry that is stated


def configuration(seed: int = 0) -> Configuration:
    """``config/uncalibrated.yaml``, with a seed."""
    return replace(load_configuration(configuration_file("uncalibrated")), seed=seed)


def suits(method: str, drive: Drive) -> bool:
    """Whether the drive has what the method needs: landmark numbers with the detections, or other robots."""
    return method not in (BATCH, WITH_ROBOTS) or drive.kind == MRCLAM


def offered(base: Configuration, everything: bool) -> list[str]:
    """Methods that run where none are named; ``everything``: with the ablations that change ``base``."""
    return [*PLAIN, *(name for name in ABLATIONS if name not in missing(base)), WITH_ROBOTS] if everything else [*PLAIN]


def missing(base: Configuration) -> list[str]:
    """Ablations that cannot be run: without a switch, or of what ``base`` has not switched on."""
    return [name for name, switched in ABLATIONS.items() if switched is None or switched(base) == base]


def checked(names: list[str], base: Configuration) -> list[str]:
    """The methods of these names, ours before all others. Raises InputError for one that cannot be run."""
    for name in names:
        if name in missing(base):
            raise InputError(f"real_drives: method '{name}' has nothing to switch off in this version; leave it out")
        if name.endswith("_calibrated"):
            raise InputError(
                f"real_drives: method '{name}' needs a calibration, which this version has not; leave it out"
            )
        if name not in offered(base, everything=True):
            raise InputError(f"real_drives: no method '{name}'; there are {', '.join(offered(base, everything=True))}")
    return [OURS, *(name for name in dict.fromkeys(names) if name != OURS)]


def prepared(method: str, base: Configuration, chosen: Chosen | None) -> Prepared:
    """Configuration of a method that the engine runs; all but ours and ablations get the noise that ours chose.

    Where ours failed and chose nothing (None), ``given`` decides by evidence itself; those that follow one hypothesis,
    which cannot, take the noise as configured.
    """
    if method in (OURS, WITH_ROBOTS):
        return Prepared(base)
    if switched := ABLATIONS.get(method):
        return Prepared(switched(base))
    if method == GIVEN:
        given = replace(base, association=GIVEN)
        return Prepared(given) if chosen is None else _told(given, chosen)
    association = "open" if method == "one_hypothesis" else method
    alone = replace(base, association=association, pruning=replace(base.pruning, max_hypotheses=1))
    return _told(alone, chosen or AS_CONFIGURED)


def _told(base: Configuration, chosen: Chosen) -> Prepared:
    """The configuration in which noise is as chosen, with nothing left to choose."""
    perception = replace(base.perception, noise_factors=(chosen.detection_factor,), ranges_are=(chosen.ranges_are,))
    errors = base.detection_errors
    share = errors.correlated_share if chosen.correlated_share is None else chosen.correlated_share
    told = replace(
        base,
        odometry=scaled(base.odometry, chosen.odometry_factor),
        perception=perception,
        detection_errors=replace(errors, correlated_share=share, correlated_shares=()),
    )
    return Prepared(told, chosen.odometry_factor)


def scaled(noise: OdometryConfiguration, factor: float) -> OdometryConfiguration:
    """Odometry whose covariance is ``factor`` times that of ``noise``, and which is not to be chosen any more."""
    root = float(np.sqrt(factor))
    return replace(
        noise,
        sigma_translation_per_m=root * noise.sigma_translation_per_m,
        sigma_rotation_per_m=root * noise.sigma_rotation_per_m,
        sigma_rotation_per_rad=root * noise.sigma_rotation_per_rad,
        sigma_translation_floor_m=root * noise.sigma_translation_floor_m,
        sigma_rotation_floor_rad=root * noise.sigma_rotation_floor_rad,
        noise_factors=(1.0,),
    )

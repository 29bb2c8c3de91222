"""The announcement of a run: its configuration as it is sent to backends, and saved with the run."""

import json
from dataclasses import replace

import numpy as np

from semantic_slam.class_models.detector import load_label_model, with_fitted_detection
from semantic_slam.class_models.embedding import load_embedding_model
from semantic_slam.class_models.file_digest import noted
from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration, to_dict
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import AssociationStrategy, strategy_of
from semantic_slam.inference.building.checks import check_settings
from semantic_slam.inference.building.spatial_checks import check_fitted, check_heights
from semantic_slam.inference.protocol import RunConfiguration, source_entry
from semantic_slam.inference.run_id import run_id_of
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.latent.model import DescriptorModel
from semantic_slam.viewpoint.model import ViewpointModel


def make_run_configuration(
    configuration: Configuration,
    map_prior: MapPrior | None,
    initial_pose: Array,
    initial_covariance: Array,
    *,
    stamp_ns: int,
    source: str = "",
    revision: str = "",
    session: int = 0,
) -> RunConfiguration:
    """Build the announcement of a run; ``initial_pose`` (7,) and ``initial_covariance`` (6, 6) in map.

    ``session`` counts the runs of one manager, so that each has an id of its own. Raises InputError for settings that
    do not go together, and when the association needs a map but the map prior has no objects.
    """
    configuration, viewpoint = _checked(configuration, map_prior, source)
    models = viewpoint or load_label_model(configuration.semantic_model)
    settings = json.dumps(to_dict(configuration), sort_keys=True)
    prior = map_prior.to_json() if map_prior else ""
    pose = np.array([float(value) for value in initial_pose])
    covariance = np.asarray(initial_covariance, dtype=np.float64)
    names = tuple(models.class_names) if models is not None else ()
    return RunConfiguration(
        run_id=run_id_of(settings, prior, pose, covariance, names) + (f".{session}" if session else ""),
        stamp_ns=stamp_ns,
        configuration=settings,
        map_prior=prior,
        initial_pose=pose,
        initial_covariance=covariance,
        class_names=names,
        source=source,
        revision=revision,
    )


def check_run(configuration: Configuration, map_prior: MapPrior | None) -> None:
    """Raise InputError for what ends a run at its first keyframe, whatever that holds; before a bag is read."""
    _checked(configuration, map_prior, source="")


def _checked(
    configuration: Configuration, map_prior: MapPrior | None, source: str
) -> tuple[Configuration, ViewpointModel | DescriptorModel | None]:
    """The configuration, completed from class models, and those that tell by viewpoint. Raises InputError."""
    association = strategy_of(configuration)
    if association.needs_map and not (map_prior and map_prior.objects):
        raise InputError(
            f"association is '{configuration.association}' but there is no map prior; give --map-prior objects.json,"
            " or set association: open to map as you go, or given for detections that carry ids"
        )
    check_settings(configuration, association)
    latent = load_latent_model(configuration.semantic_model)
    configuration = _with_class_models(configuration, association, source, latent)
    viewpoint = load_model(configuration.semantic_model)
    check_heights(configuration, viewpoint)
    return configuration, viewpoint or latent


def _with_class_models(
    configuration: Configuration, association: type[AssociationStrategy], source: str, latent: DescriptorModel | None
) -> Configuration:
    """The configuration, completed from the class models' files: latent space, digests, fitted detection probability.

    Backends, reports and queries thus know the space of the descriptors, and which files they have to find. Raises
    InputError for what was fitted and does not go with the run.
    """
    models, world = configuration.semantic_model, configuration.open_world
    described = latent or load_embedding_model(models)
    if described is not None:
        models = replace(models, space=described.space)
    models = noted(models)
    if association.counts_misses and not world.learn_region:
        world = with_fitted_detection(world, models, source_entry(source, "sha256"))
    completed = replace(configuration, semantic_model=models, open_world=world)
    check_fitted(completed)
    return completed

"""Construction of the inference problem from a run's announcement."""

import json

from semantic_slam.configuration import Configuration, from_dict
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.building.association_settings import as_used, moving_of, noise_settings_of, while_lost
from semantic_slam.inference.building.class_prior import even_classes
from semantic_slam.inference.building.clutter import clutter_of
from semantic_slam.inference.building.known_objects import KnownObjects, known_objects
from semantic_slam.inference.building.map_descriptors import appearances_of, latent_observation_of
from semantic_slam.inference.building.run_models import RunModels
from semantic_slam.inference.building.sensing import sensing_of
from semantic_slam.inference.building.views import semantics_name
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.semantics.interface import ClassModels, Semantics
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.world.carried import Carried
from semantic_slam.inference.world.inferred_noise import InferredNoise
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.slips import Slips
from semantic_slam.inference.world.starts import Starts
from semantic_slam.registry import SEMANTICS
from semantic_slam.viewpoint.novelty import QUANTILE


def problem_of(run: RunConfiguration) -> Problem:
    """Build the inference problem of an announced run. Raises InputError."""
    configuration = from_dict(json.loads(run.configuration), "run configuration")
    association = strategy_of(configuration)
    configuration = as_used(configuration, association)
    models = RunModels.load(configuration.semantic_model, run.source_sha256)
    sensing, clutter = sensing_of(configuration, models), clutter_of(configuration, models)
    known = known_objects(run, configuration, sensing, may_lack=clutter is not None)
    latent = latent_observation_of(models, known.prior, known.entries)
    robot = sensing.robot_prior(run.initial_pose, run.initial_covariance)
    is_relocated = bool(known.entries) and configuration.revision.lost_every_keyframes > 0
    starts = Starts.of(robot) if is_relocated else None
    noise_settings = noise_settings_of(configuration, association)
    rates = DetectionRates.of(configuration.open_world)
    return Problem(
        viewpoint=models.viewpoint,
        carried=Carried.of(configuration.revision),
        slips=Slips.of(configuration.odometry),
        starts=starts,
        inferred_noise=InferredNoise.of(configuration, noise_settings, rates),
        noise_settings=noise_settings,
        sigma_metre=configuration.perception.sigma_range_scale,
        spaces=sensing.spaces,
        model=sensing.model,
        reader=sensing.reader,
        robot=robot,
        objects=known.entries,
        joint=known.joint,
        class_names=run.class_names,
        class_shares=models.labels.class_shares if models.labels is not None else even_classes(len(run.class_names)),
        seed=configuration.seed,
        association=association,
        semantics=_semantics(configuration, models, known, latent),
        latent=latent,
        embeddings=models.embeddings,
        moving=moving_of(configuration, association),
        clutter=clutter,
        unmapped_ids=known.unmapped_ids,
        displaced=known.displaced,
        novelty_false_alarms=configuration.perception.novelty_false_alarms + 1.0 - QUANTILE,
        distinct=configuration.distinct_assignment,
        weights=configuration.weights,
        pruning=configuration.pruning if starts is None else while_lost(configuration),
        open_world=configuration.open_world,
        detection_errors=configuration.detection_errors,
        revision=configuration.revision,
        history=configuration.history,
        closed_world=configuration.closed_world,
    )


def _semantics(
    configuration: Configuration, models: RunModels, known: KnownObjects, latent: LatentObservation | None
) -> Semantics:
    """The semantics of the configured class models: they weigh views of objects, and keep records of them."""
    kind: type[Semantics] = SEMANTICS.load(semantics_name(configuration))
    return kind.of(
        ClassModels(
            configuration=configuration,
            viewpoint=models.viewpoint,
            latent=latent,
            tempering=models.tempering,
            outliers=models.outliers,
            labels=models.labels,
            embeddings=models.embeddings,
            appearances=appearances_of(models, known.prior),
        )
    )

"""A run's configuration as it is announced, and the problem that follows from it."""

import json
from dataclasses import replace

import numpy as np

from semantic_slam.configuration import Configuration, SemanticModelConfiguration, from_dict, to_dict
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, planar_from_covariance, planar_from_pose_vector
from semantic_slam.geometry.se2 import rotate_covariance
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.models.latent_observation import LatentObservation
from semantic_slam.inference.models.latent_prior import prior_of_classes
from semantic_slam.inference.models.odometry_bias import bias_sigmas
from semantic_slam.inference.models.planar_observation import PlanarObservation
from semantic_slam.inference.models.visibility import PlanarVisibility
from semantic_slam.inference.planar_reader import PlanarReader
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.semantics.interface import Semantics
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.identity import digest
from semantic_slam.inference.states.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior, parse_map_prior
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.problem import Problem
from semantic_slam.latent.load import load_latent_model
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel
from semantic_slam.registry import ASSOCIATIONS, SEMANTICS
from semantic_slam.viewpoint.correlated import CorrelatedModel
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.load import load_model
from semantic_slam.viewpoint.model import ViewpointModel

LEAST_CLASS_SHARE = 0.01
"""Share of the uniform distribution in every prior over classes."""
LEAST_VARIANCE = 1e-9
"""Added to the variances of priors, so that a map given as exact keeps the graph regular."""


def make_run_configuration(
    configuration: Configuration,
    map_prior: MapPrior | None,
    initial_pose: Array,
    initial_covariance: Array,
    *,
    stamp_ns: int,
    source: str = "",
    revision: str = "",
) -> RunConfiguration:
    """The announcement of a run; ``initial_pose`` (7,) and ``initial_covariance`` (6, 6) in map.

    Raises InputError when detections have to be associated with a map that has no objects.
    """
    association: type[AssociationStrategy] = ASSOCIATIONS.load(configuration.association)
    if association.needs_map and not (map_prior and map_prior.objects):
        raise InputError(
            f"association is '{configuration.association}' but there is no map prior; give --map-prior objects.json,"
            " or set association: open to map as you go, or given for detections that carry ids"
        )
    association.check(configuration)
    _check_odometry(configuration, association)
    latent = load_latent_model(configuration.semantic_model)
    if latent is not None:  # so that backends, reports and queries know the space of the descriptors
        noted = replace(configuration.semantic_model, space=latent.space)
        configuration = replace(configuration, semantic_model=noted)
    settings = json.dumps(to_dict(configuration), sort_keys=True)
    prior = map_prior.to_json() if map_prior else ""
    pose = [float(value) for value in initial_pose]
    covariance = np.asarray(initial_covariance, dtype=np.float64)
    model = load_model(configuration.semantic_model) or latent
    names = model.class_names if model is not None else ()
    run_id = digest(settings, prior, json.dumps(pose), json.dumps(covariance.tolist()), *names)
    return RunConfiguration(
        run_id=run_id,
        stamp_ns=stamp_ns,
        configuration=settings,
        map_prior=prior,
        initial_pose=np.array(pose),
        initial_covariance=covariance,
        class_names=tuple(names),
        source=source,
        revision=revision,
    )


def _check_odometry(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    factors, is_open = configuration.odometry.noise_factors, association.tracks_objects
    if not factors or min(factors) <= 0.0 or (factors != (1.0,) and not is_open):
        raise InputError("odometry.noise_factors must be positive, and other than [1.0] only with association: open")
    single_steps = is_open and not configuration.open_world.settle
    if configuration.odometry.estimate_bias and not single_steps:
        raise InputError(
            "odometry.estimate_bias works only where updates are not iterated;"
            " set association: open and open_world.settle: false"
        )


def initial_pose_of(configuration: Configuration) -> tuple[Array, Array]:
    """Planar initial pose (7,) and covariance (6, 6) of the configuration."""
    mean, sigma = np.array(configuration.initial_pose.mean), np.array(configuration.initial_pose.sigma)
    x, y, yaw = mean
    pose = np.array([x, y, 0.0, 0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])
    return pose, covariance_from_planar(np.diag(sigma**2))


def problem_of(run: RunConfiguration) -> Problem:
    """The planar problem that a run announces."""
    configuration = from_dict(json.loads(run.configuration), "run configuration")
    model = load_model(configuration.semantic_model)
    visibility = configuration.visibility
    prior = parse_map_prior(run.map_prior, "map prior") if run.map_prior else MapPrior()
    objects = tuple(_entry(item, run.class_names) for item in prior.objects)
    descriptors = load_latent_model(configuration.semantic_model)
    latent = _latent(configuration, descriptors, prior, objects) if descriptors is not None else None
    biases = bias_sigmas(configuration.odometry)
    return Problem(
        num_biases=len(biases),
        noise_factors=configuration.odometry.noise_factors,
        spaces=Spaces.same(PlanarPoses()),
        model=PlanarObservation(
            model if _in_graph(configuration) else None,
            PlanarVisibility(visibility.max_range_m, visibility.field_of_view_rad, visibility.softness),
            configuration.new_objects,
            _correlated_views(configuration.semantic_model),
        ),
        reader=PlanarReader(_num_features(model or descriptors), biases.tolist()),
        robot=_planar_prior(run.initial_pose, run.initial_covariance),
        objects=objects,
        class_names=run.class_names,
        seed=configuration.seed,
        association=configuration.association,
        semantics=_semantics(configuration, model, latent),
        latent=latent,
        distinct=configuration.distinct_assignment,
        weights=configuration.weights,
        pruning=configuration.pruning,
        open_world=configuration.open_world,
    )


def _num_features(model: ViewpointModel | DescriptorModel | None) -> int:
    return model.num_features if model is not None else 0


def _latent(
    configuration: Configuration, model: DescriptorModel, prior: MapPrior, objects: tuple[ObjectEntry, ...]
) -> LatentObservation:
    """With what a map tells of its objects: their descriptors, or else their classes. Raises InputError."""
    if prior.descriptor_space != model.space and any(len(item.descriptor) for item in prior.objects):
        raise InputError(
            f"map prior: its descriptors are of the latent space '{prior.descriptor_space}', the model's is"
            f" '{model.space}'; use the semantic_model.path that the map was made with"
        )
    known = {entry.object_id: prior_of_classes(model, entry.class_prior) for entry in objects}
    known |= {item.object_id: _descriptor(item, model) for item in prior.objects if len(item.descriptor)}
    return LatentObservation(model, _correlated_views(configuration.semantic_model), known)


def _descriptor(item: ObjectPrior, model: DescriptorModel) -> DescriptorBelief:
    """Raises InputError for a descriptor of another length."""
    if len(item.descriptor) != model.num_dimensions:
        raise InputError(
            f"map prior: object {item.object_id} has a descriptor of {len(item.descriptor)} components, the latent"
            f" space has {model.num_dimensions}; write the map anew"
        )
    return DescriptorBelief(item.descriptor[None], np.sqrt(item.descriptor_variance)[None])


def _semantics(
    configuration: Configuration, model: ViewpointModel | None, latent: LatentObservation | None
) -> Semantics:
    """The strategy that suits the class models, and whether headings are known before views enter."""
    settings, tempering = configuration.semantic_model, _correlated_views(configuration.semantic_model)
    carries_views = ASSOCIATIONS.load(configuration.association).carries_views
    if latent is not None:
        return _make("descriptor_tables" if carries_views else "descriptor_views", latent)
    if isinstance(model, GaussianProcessModel) and settings.kind == "gp_correlated":
        correlated = CorrelatedModel(model, settings.sigma_view)
        averaging = settings.num_tracks, settings.window, settings.track_average, configuration.seed
        return _make("correlated_views", correlated, *averaging)
    if model is None:
        return _make("none")
    return _make("independent_views" if _in_graph(configuration) else "class_tables", model, tempering)


def _make(name: str, *arguments: object) -> Semantics:
    semantics: Semantics = SEMANTICS.load(name)(*arguments)
    return semantics


def _in_graph(configuration: Configuration) -> bool:
    """Whether semantic measurements enter by factors, under classes that hypotheses enumerate."""
    association = ASSOCIATIONS.load(configuration.association)
    carried = association.carries_views and configuration.open_world.classes == "carried"
    return configuration.semantic_model.kind != "gp_correlated" and not carried


def _correlated_views(settings: SemanticModelConfiguration) -> float:
    """The parametric model is exact by definition; fitted models meet the same error in view after view."""
    return settings.correlated_views if settings.kind in ("gp_independent", "latent") else 1.0


def _planar_prior(pose: Array, covariance: Array) -> GaussianPrior:
    """Prior in the tangent space at the mean, from a covariance along the axes of map."""
    mean = planar_from_pose_vector(pose)
    planar = rotate_covariance(mean, planar_from_covariance(covariance), to_parent=False)
    return GaussianPrior(mean, planar + LEAST_VARIANCE * np.eye(3))


def _entry(item: ObjectPrior, class_names: tuple[str, ...]) -> ObjectEntry:
    """Raises InputError for a class that the class models do not know."""
    unknown = sorted(set(item.class_probabilities) - set(class_names))
    if unknown and class_names:
        raise InputError(
            f"map prior: object {item.object_id} has the unknown class '{unknown[0]}'; the class models know"
            f" {', '.join(class_names)}"
        )
    return ObjectEntry(
        item.object_id,
        item.name,
        _planar_prior(item.pose, item.covariance),
        _class_prior(item, class_names),
        item.existence,
    )


def _class_prior(item: ObjectPrior, class_names: tuple[str, ...]) -> Array:
    """(C,) probabilities; none is zero, for what an earlier run discarded may have been the truth."""
    uniform = np.full(len(class_names), 1.0 / max(len(class_names), 1))
    given = np.array([item.class_probabilities.get(name, 0.0) for name in class_names])
    if given.sum() <= 0.0:
        return uniform
    return np.asarray((1.0 - LEAST_CLASS_SHARE) * given / given.sum() + LEAST_CLASS_SHARE * uniform)

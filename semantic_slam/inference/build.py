"""A run's configuration as it is announced, and the problem that follows from it."""

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from semantic_slam.class_models.detector import load_label_model, with_fitted_detection
from semantic_slam.class_models.embedding import load_embedding_model
from semantic_slam.class_models.file_digest import check_digest, noted
from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration, SemanticModelConfiguration, from_dict, to_dict
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar
from semantic_slam.inference.association.strategy import AssociationStrategy, strategy_of
from semantic_slam.inference.models.clutter import EvenClutter
from semantic_slam.inference.models.latent_observation import LatentObservation
from semantic_slam.inference.models.latent_prior import prior_of_classes
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.noise_settings import DEPTH, DISTANCE, NoiseSettings
from semantic_slam.inference.models.planar_detection import PlanarDetection, PlanarDetections
from semantic_slam.inference.protocol import RunConfiguration, told_of
from semantic_slam.inference.reference import NO_SCORES, EvenWords, KeyframeScores, Reference, ScoreDensity
from semantic_slam.inference.semantics.interface import ClassModels, Semantics
from semantic_slam.inference.smoothing.horizon import check_horizon
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.gaussian import JointPrior
from semantic_slam.inference.states.identity import digest
from semantic_slam.inference.world.carried import Carried
from semantic_slam.inference.world.displaced_objects import Displaced, with_displaced
from semantic_slam.inference.world.inferred_noise import InferredNoise
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior, parse_map_prior
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.sensing import PriorReader, Sensing, SensingBuilder, SensingSettings
from semantic_slam.inference.world.starts import Starts
from semantic_slam.inference.world.unmapped import unmapped_objects
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel
from semantic_slam.registry import OBSERVATIONS, SEMANTICS
from semantic_slam.viewpoint.embedding_model import EmbeddingModel, EmbeddingRecord
from semantic_slam.viewpoint.label_model import LabelModel
from semantic_slam.viewpoint.model import ViewpointModel, feature_names
from semantic_slam.viewpoint.novelty import QUANTILE
from semantic_slam.viewpoint.outliers import OutlierScores

LEAST_CLASS_SHARE = 0.01
"""Share of the uniform distribution in every prior over classes."""


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
    """The announcement of a run; ``initial_pose`` (7,) and ``initial_covariance`` (6, 6) in map.

    ``session`` counts the runs of one manager, so that each has an id of its own.
    Raises InputError when detections have to be associated with a map that has no objects.
    """
    association = strategy_of(configuration)
    if association.needs_map and not (map_prior and map_prior.objects):
        raise InputError(
            f"association is '{configuration.association}' but there is no map prior; give --map-prior objects.json,"
            " or set association: open to map as you go, or given for detections that carry ids"
        )
    association.check(configuration)
    semantics_name(configuration)
    _check_odometry(configuration, association)
    _check_detections(configuration, association)
    _check_revision(configuration, association)
    _check_moving(configuration, association)
    check_horizon(configuration)
    latent = load_latent_model(configuration.semantic_model)
    described = latent or load_embedding_model(configuration.semantic_model)
    if described is not None:  # so that backends, reports and queries know the space of the descriptors
        with_space = replace(configuration.semantic_model, space=described.space)
        configuration = replace(configuration, semantic_model=with_space)
    configuration = replace(configuration, semantic_model=noted(configuration.semantic_model))
    if association.counts_misses and not configuration.open_world.learn_region:
        world = with_fitted_detection(configuration.open_world, configuration.semantic_model, told_of(source, "sha256"))
        configuration = replace(configuration, open_world=world)
    settings = json.dumps(to_dict(configuration), sort_keys=True)
    prior = map_prior.to_json() if map_prior else ""
    pose = [float(value) for value in initial_pose]
    covariance = np.asarray(initial_covariance, dtype=np.float64)
    settled = configuration.semantic_model
    model = load_model(settled) or latent or load_label_model(settled)
    names = model.class_names if model is not None else ()
    return RunConfiguration(
        run_id=run_id_of(settings, prior, np.array(pose), covariance, names) + (f".{session}" if session else ""),
        stamp_ns=stamp_ns,
        configuration=settings,
        map_prior=prior,
        initial_pose=np.array(pose),
        initial_covariance=covariance,
        class_names=tuple(names),
        source=source,
        revision=revision,
    )


def run_id_of(settings: str, prior: str, pose: Array, covariance: Array, class_names: Sequence[str]) -> str:
    """Digest of all that determines a run besides its keyframes."""
    return digest(settings, prior, json.dumps(pose.tolist()), json.dumps(covariance.tolist()), *class_names)


def is_id_of_its_contents(run: RunConfiguration) -> bool:
    """Whether the id that a run is announced by, its session apart, is that of what it says."""
    told = (run.configuration, run.map_prior, run.initial_pose, run.initial_covariance, run.class_names)
    return run.run_id.partition(".")[0] == run_id_of(*told)


def _check_odometry(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    factors, tracks = configuration.odometry.noise_factors, association.tracks_objects
    if not factors or min(factors) <= 0.0 or (factors != (1.0,) and not tracks):
        raise InputError(
            "odometry.noise_factors must be positive, and other than [1.0] only with association: open, or given with"
            " open_world.iterate_updates: false"
        )
    single_steps = tracks and not configuration.open_world.iterate_updates
    if configuration.odometry.estimate_bias and not single_steps:
        raise InputError(
            "odometry.estimate_bias works only where updates are not iterated;"
            " set association: open, or given, and open_world.iterate_updates: false"
        )
    if configuration.detection_errors.correlated_share > 0.0 and not single_steps:
        raise InputError(
            "detection_errors.correlated_share works only where updates are not iterated;"
            " set association: open, or given, and open_world.iterate_updates: false"
        )
    errors = configuration.detection_errors
    if (errors.sigma_range_offset_m or errors.sigma_yaw_rad) and errors.correlated_share <= 0.0:
        raise InputError(
            "detection_errors.sigma_range_offset_m and sigma_yaw_rad need detection_errors.correlated_share above 0;"
            " set it, or both of them to 0"
        )


def _check_detections(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    factors, probabilities = configuration.perception.noise_factors, configuration.open_world.detection_probabilities
    may_differ = association.tracks_objects and _sees_places_in_single_steps(configuration)
    if not factors or min(factors) <= 0.0 or (factors != (1.0,) and not may_differ):
        raise InputError(
            "perception.noise_factors must be positive, and other than [1.0] only with association: open or given,"
            " open_world.iterate_updates: false and semantic_model.kind: none or detector"
        )
    kinds = configuration.perception.ranges_are
    if not kinds or not {DISTANCE, DEPTH}.issuperset(kinds) or (kinds != (DISTANCE,) and not may_differ):
        raise InputError(
            "perception.ranges_are must be distance, depth or both, and other than [distance] only where"
            " perception.noise_factors may be"
        )
    if probabilities and not 0.0 < min(probabilities) <= max(probabilities) < 1.0:
        raise InputError("open_world.detection_probabilities must lie between 0 and 1; correct them")
    if min(configuration.open_world.detection_half_ranges_m, default=1.0) <= 0.0:
        raise InputError("open_world.detection_half_ranges_m must be above 0; correct them")
    if not all(0.0 <= own < 1.0 for own in configuration.open_world.miss_persistences):
        raise InputError("open_world.miss_persistences must not be below 0, and be below 1; correct them")
    if min(configuration.open_world.clutters_per_frame, default=0.0) < 0.0:
        raise InputError("open_world.clutters_per_frame must not be below 0; correct them")
    if min(configuration.open_world.birth_densities, default=1.0) <= 0.0:
        raise InputError("open_world.birth_densities must be above 0; correct them")


def _check_revision(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    revision, tracks = configuration.revision, association.tracks_objects
    if revision.every_keyframes > 0 and not tracks:
        raise InputError(
            "revision.every_keyframes is for worlds without a map; set association: open, or set it to 0 (given with"
            " open_world.iterate_updates: false has nothing to revise)"
        )
    if revision.reassociate_every_keyframes > 0 and not tracks:
        raise InputError("revision.reassociate_every_keyframes is for association: open; set that, or set it to 0")
    if revision.lost_every_keyframes > 0 and not tracks:
        raise InputError("revision.lost_every_keyframes is for association: open; set that, or set it to 0")


def _check_moving(configuration: Configuration, association: type[AssociationStrategy]) -> None:
    moving = _moving(configuration, association)
    plain = _sees_places_in_single_steps(configuration)
    if moving.is_on and association.tracks_objects and not (plain and len(moving.speeds)):
        raise InputError(
            "moving.share and moving.share_by_label are for open_world.iterate_updates: false and"
            " semantic_model.kind: none or detector; set these, or the shares to 0"
        )


def _sees_places_in_single_steps(configuration: Configuration) -> bool:
    """Whether updates are not iterated, and no view tells how its object is turned."""
    kind = class_model_kind(configuration.semantic_model)
    return kind.sees_places_alone and not configuration.open_world.iterate_updates


def _moving(configuration: Configuration, association: type[AssociationStrategy]) -> Moving:
    """What may move: nothing where detections carry the identity of their object."""
    if association.wants_identities:
        return Moving()
    return Moving(configuration.moving, configuration.detection_errors)


def _noises(configuration: Configuration, association: type[AssociationStrategy]) -> tuple[NoiseSettings | None, ...]:
    """What hypotheses may take the noises to be; where objects are not tracked, all is as told."""
    return NoiseSettings.grid(configuration) if association.tracks_objects else (None,)


def _as_used(configuration: Configuration, association: type[AssociationStrategy]) -> Configuration:
    """Without what ``association`` has no use for: names leave nothing to revise, and misses may not count."""
    revision, world = configuration.revision, configuration.open_world
    if association.wants_identities:
        revision = replace(revision, every_keyframes=0, lost_every_keyframes=0)
    if not association.counts_misses:
        world = replace(
            world,
            detection_probabilities=(),
            detection_half_ranges_m=(),
            birth_densities=(),
            clutters_per_frame=(),
            miss_persistence=0.0,
            miss_persistences=(),
        )
    return replace(configuration, revision=revision, open_world=world)


def initial_pose_of(configuration: Configuration) -> tuple[Array, Array]:
    """Planar initial pose (7,) and covariance (6, 6) of the configuration."""
    mean, sigma = np.array(configuration.initial_pose.mean), np.array(configuration.initial_pose.sigma)
    x, y, yaw = mean
    pose = np.array([x, y, 0.0, 0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])
    return pose, covariance_from_planar(np.diag(sigma**2))


def problem_of(run: RunConfiguration) -> Problem:
    """The problem that a run announces."""
    configuration = from_dict(json.loads(run.configuration), "run configuration")
    association = strategy_of(configuration)
    configuration = _as_used(configuration, association)
    settings = configuration.semantic_model
    check_digest(settings)
    tempering = _tempering(settings)
    model, descriptors = load_model(settings), load_latent_model(settings)
    labels = load_label_model(settings, run.source_sha256)
    outliers, embeddings = _outliers(model, settings), load_embedding_model(settings)
    sensing = _sensing(configuration, model, descriptors, outliers, labels, embeddings)
    prior = parse_map_prior(run.map_prior, "map prior") if run.map_prior else MapPrior()
    clutter = _clutter(configuration, model, labels)
    unmapped = _unmapped(configuration, association, prior) if clutter is not None else ()
    prior, displaced = _with_displaced(configuration, association, prior, unmapped)
    prior = replace(prior, objects=(*prior.objects, *unmapped))
    objects = tuple(_entry(item, run.class_names, sensing.object_prior) for item in prior.objects)
    latent = _latent(descriptors, tempering, prior, objects) if descriptors is not None else None
    semantics: type[Semantics] = SEMANTICS.load(semantics_name(configuration))
    noises = _noises(configuration, association)
    robot = sensing.robot_prior(run.initial_pose, run.initial_covariance)
    is_relocated = bool(objects) and configuration.revision.lost_every_keyframes > 0
    return Problem(
        viewpoint=model,
        carried=Carried.of(configuration.revision),
        starts=Starts.of(robot) if is_relocated else None,
        inferred_noise=InferredNoise.of(configuration, noises, DetectionRates.of(configuration.open_world)),
        noises=noises,
        sigma_metre=configuration.perception.sigma_range_scale,
        spaces=sensing.spaces,
        model=sensing.model,
        reader=sensing.reader,
        robot=robot,
        objects=objects,
        joint=_joint(prior, sensing),
        class_names=run.class_names,
        class_shares=labels.class_shares if labels is not None else _even(len(run.class_names)),
        seed=configuration.seed,
        association=association,
        semantics=semantics.of(
            ClassModels(
                configuration=configuration,
                viewpoint=model,
                latent=latent,
                tempering=tempering,
                outliers=outliers,
                labels=labels,
                embeddings=embeddings,
                appearances={} if embeddings is None else _appearances(embeddings, prior),
            )
        ),
        latent=latent,
        embeddings=embeddings,
        novelty_false_alarms=configuration.perception.novelty_false_alarms + 1.0 - QUANTILE,
        distinct=configuration.distinct_assignment,
        weights=configuration.weights,
        pruning=configuration.pruning,
        open_world=configuration.open_world,
        detection_errors=configuration.detection_errors,
        revision=configuration.revision,
        history=configuration.history,
        moving=_moving(configuration, association),
        clutter=clutter,
        unmapped_ids=frozenset(item.object_id for item in unmapped),
        displaced=displaced,
        closed_world=configuration.closed_world,
    )


def reference_of(run: RunConfiguration, problem: Problem) -> Reference:
    """The model that explains nothing, by which it is told whether the belief of a run explains its data.

    ``problem`` is the one that the run announces.
    """
    configuration = from_dict(json.loads(run.configuration), "run configuration")
    settings = configuration.semantic_model
    model, labels = load_model(settings), load_label_model(settings)
    scores: KeyframeScores = NO_SCORES
    if labels is not None:
        scores = EvenWords(labels.num_words)
    elif model is not None:
        scores = ScoreDensity.of_classes(model, _tempering(settings))
    elif problem.latent is not None:
        scores = ScoreDensity.of_descriptors(problem.latent)
    return Reference(configuration, problem.objects, scores)


def _clutter(
    configuration: Configuration, model: ViewpointModel | None, labels: LabelModel | None
) -> EvenClutter | None:
    """What detections of no object look like; None where views have evidence without a floor, which it would replace.

    Those are views that share their errors, and descriptors.
    """
    kind = class_model_kind(configuration.semantic_model)
    if labels is not None:
        even = EvenWords(labels.num_words).log_density
        return EvenClutter.of(configuration.open_world, lambda seen: np.array([even([own]) for own in seen]))
    if kind.sees_places_alone:
        return EvenClutter.of(configuration.open_world, None)
    if model is None or not kind.has_factors:
        return None
    broad, tempering = OutlierScores.of(model, 0.0), _tempering(configuration.semantic_model)

    def log_scores(detections: Sequence[PlanarDetection]) -> Array:
        seen = PlanarDetections.of(detections)
        return broad.log_density(seen.feature, seen.feature_covariance) / tempering

    return EvenClutter.of(configuration.open_world, log_scores)


def _unmapped(
    configuration: Configuration, association: type[AssociationStrategy], prior: MapPrior
) -> tuple[ObjectPrior, ...]:
    """What the map may lack, where detections are associated with a map, some of them with none of its objects."""
    settings = configuration.closed_world
    if not association.needs_map or association.tracks_objects or settings.clutter_per_frame <= 0.0:
        return ()
    reach, heading = configuration.open_world.max_range_m, configuration.new_objects.sigma_heading_rad
    return unmapped_objects(prior, settings.unmapped_objects, settings.unmapped_probability, reach, heading)


def _with_displaced(
    configuration: Configuration,
    association: type[AssociationStrategy],
    prior: MapPrior,
    unmapped: Sequence[ObjectPrior],
) -> tuple[MapPrior, Displaced]:
    """The map, with where its objects may be besides, where detections are associated with it."""
    settings = configuration.closed_world
    if not association.needs_map or association.tracks_objects:
        return prior, Displaced()
    first = 1 + max(item.object_id for item in (*prior.objects, *unmapped))
    return with_displaced(prior, settings.displaced_share, settings.displaced_sigma_m, first)


def _outliers(model: ViewpointModel | None, settings: SemanticModelConfiguration) -> OutlierScores | None:
    """What a view's score may be besides what the class models say; None: no view is an outlier."""
    return OutlierScores.of(model, settings.outlier_share) if model is not None and settings.outlier_share else None


def _sensing(
    configuration: Configuration,
    model: ViewpointModel | None,
    descriptors: DescriptorModel | None,
    outliers: OutlierScores | None,
    labels: LabelModel | None,
    embeddings: EmbeddingModel | None,
) -> Sensing:
    """The state space, and the observation model over it, with the class models where views enter by factors."""
    explained = model or descriptors
    build: SensingBuilder = OBSERVATIONS.load(configuration.observation)
    return build(
        SensingSettings(
            configuration=configuration,
            tracks_objects=strategy_of(configuration).tracks_objects,
            class_model=model if _views_are_factors(configuration) else None,
            tempering=_tempering(configuration.semantic_model),
            outliers=outliers,
            num_features=explained.num_features if explained is not None else 0,
            feature_names=feature_names(model) if model is not None else (),
            labels=labels.labels if labels is not None else (),
            vector_dimensions=embeddings.dimensions if embeddings is not None else 0,
        )
    )


def _latent(
    model: DescriptorModel, tempering: float, prior: MapPrior, objects: tuple[ObjectEntry, ...]
) -> LatentObservation:
    """With what a map tells of its objects: their descriptors, or else their classes. Raises InputError."""
    _check_space(prior, model.space, "semantic_model.path")
    known = {entry.object_id: prior_of_classes(model, entry.class_prior) for entry in objects}
    known |= {item.object_id: _descriptor(item, model) for item in prior.objects if len(item.descriptor)}
    return LatentObservation(model, tempering, known)


def _appearances(model: EmbeddingModel, prior: MapPrior) -> dict[int, EmbeddingRecord]:
    """Object id -> what the map tells of its looks. Raises InputError."""
    _check_space(prior, model.space, "semantic_model.kind and embedding_dimensions")
    described = [item for item in prior.objects if len(item.descriptor)]
    for item in described:
        _check_length(item, model.dimensions)
    return {item.object_id: model.start(item.descriptor, float(item.descriptor_variance.sum())) for item in described}


def _check_space(prior: MapPrior, space: str, parameters: str) -> None:
    if prior.descriptor_space != space and any(len(item.descriptor) for item in prior.objects):
        raise InputError(
            f"map prior: its descriptors are of the latent space '{prior.descriptor_space}', the model's is"
            f" '{space}'; use the {parameters} that the map was made with"
        )


def _check_length(item: ObjectPrior, dimensions: int) -> None:
    if len(item.descriptor) != dimensions:
        raise InputError(
            f"map prior: object {item.object_id} has a descriptor of {len(item.descriptor)} components, the latent"
            f" space has {dimensions}; write the map anew"
        )


def _descriptor(item: ObjectPrior, model: DescriptorModel) -> DescriptorBelief:
    """Raises InputError for a descriptor of another length."""
    _check_length(item, model.num_dimensions)
    return DescriptorBelief(item.descriptor[None], np.sqrt(item.descriptor_variance)[None])


def semantics_name(configuration: Configuration) -> str:
    """Semantics that suit the class models, and whether headings are known before views enter. Raises InputError."""
    kind = class_model_kind(configuration.semantic_model)
    if not _carries_views(configuration):
        return kind.semantics
    if kind.carried is None:
        raise InputError(
            f"association: {configuration.association} has no {configuration.semantic_model.kind} class models;"
            " set semantic_model.kind: gp_independent"
        )
    return kind.carried


def _carries_views(configuration: Configuration) -> bool:
    """Whether views stay with the objects of a hypothesis until it is known how these are turned."""
    association = strategy_of(configuration)
    enumerates = configuration.open_world.classes == "enumerated"
    has_factors = class_model_kind(configuration.semantic_model).has_factors
    return association.carries_views and not (has_factors and enumerates)


def _views_are_factors(configuration: Configuration) -> bool:
    """Whether semantic measurements enter by factors, under classes that hypotheses enumerate."""
    return class_model_kind(configuration.semantic_model).has_factors and not _carries_views(configuration)


def _tempering(settings: SemanticModelConfiguration) -> float:
    """So many views tell as much as one."""
    return settings.likelihood_tempering if class_model_kind(settings).repeats_errors else 1.0


def _entry(item: ObjectPrior, class_names: tuple[str, ...], prior: PriorReader) -> ObjectEntry:
    """Raises InputError for a class that the class models do not know."""
    unknown = sorted(set(item.class_probabilities) - set(class_names))
    if unknown and class_names:
        raise InputError(
            f"map prior: object {item.object_id} has the unknown class '{unknown[0]}'; the class models know"
            f" {', '.join(class_names)}"
        )
    return ObjectEntry(
        object_id=item.object_id,
        name=item.name,
        prior=prior(item.pose, item.covariance),
        class_prior=class_prior(item, class_names),
        existence=item.existence,
    )


def class_prior(item: ObjectPrior, class_names: tuple[str, ...]) -> Array:
    """(C,) probabilities; none is zero, for what an earlier run discarded may have been the truth."""
    uniform = _even(len(class_names))
    given = np.array([item.class_probabilities.get(name, 0.0) for name in class_names])
    if given.sum() <= 0.0:
        return uniform
    return np.asarray((1.0 - LEAST_CLASS_SHARE) * given / given.sum() + LEAST_CLASS_SHARE * uniform)


def _joint(prior: MapPrior, sensing: Sensing) -> JointPrior | None:
    """What the map's objects have in common, where the map tells; what it may lack or have elsewhere comes after."""
    if prior.joint_covariance is None or len(prior.joint_covariance) <= 3:
        return None
    mapped = prior.objects[: len(prior.joint_covariance) // 3]
    poses = np.array([item.pose for item in mapped])
    return JointPrior(tuple(item.object_id for item in mapped), sensing.joint_prior(poses, prior.joint_covariance))


def _even(num_classes: int) -> Array:
    """(C,) probabilities of classes of which nothing is known."""
    return np.full(num_classes, 1.0 / max(num_classes, 1))

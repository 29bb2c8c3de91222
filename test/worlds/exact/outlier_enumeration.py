"""A linear world with clutter and outliers among the scores, and its belief by a sum over every choice."""

import itertools
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from worlds.exact.exact_fixtures import NO_PRUNING
from worlds.exact.linear_gaussian import LinearDetection, LinearDetections, LinearModel, StepReader

from semantic_slam.configuration import ClosedWorldConfiguration, WeightsConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.enumerated import EnumeratedAssociation
from semantic_slam.inference.association.given import GivenAssociation
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.models.observation import Linearisation
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.problem import Problem
from semantic_slam.viewpoint.outliers import OutlierScores

AREA_M2 = 20.0


@dataclass(frozen=True)
class RobustLinearModel(LinearModel):
    outliers: OutlierScores

    def semantics(self, seen, x, o, classes):
        part = super().semantics(seen, x, o, classes)
        squared = (part.residual**2).sum(-1)
        log_mixed, inlier = self._mixed(part.log_normaliser - 0.5 * squared, seen, classes)
        share = np.sqrt(inlier)[:, None]
        return Linearisation(
            residual=share * part.residual,
            jacobian_robot=share[..., None] * part.jacobian_robot,
            jacobian_object=share[..., None] * part.jacobian_object,
            log_normaliser=log_mixed + 0.5 * inlier * squared,
        )

    def log_likelihood(self, seen, x, o, classes):
        total = super().log_likelihood(seen, x, o, None)
        if classes is None:
            return total
        part = self.semantics(seen, x, o, classes)
        return total + part.log_normaliser - 0.5 * (part.residual**2).sum(-1)

    def log_outlier(self, seen):
        return np.log(self.outliers.share) + log_scores(self, seen)

    def _mixed(self, log_inlier, seen, classes):
        log_outlier = np.tile(log_scores(self, seen), len(log_inlier) // len(seen.sem))
        return self.outliers.mixed(np.where(classes < 0, -np.inf, log_inlier), log_outlier)


def log_scores(model: RobustLinearModel, seen: LinearDetections) -> Array:
    """(n,) log density of scores as outliers."""
    return model.outliers.log_density(seen.sem, np.zeros((len(seen.sem), 2, 2)))


@dataclass(frozen=True)
class LinearClutter:
    model: RobustLinearModel | None

    def log_place(self, detections):
        return np.full(len(detections), -np.log(AREA_M2))

    def log_scores(self, detections):
        return (
            np.zeros(len(detections)) if self.model is None else log_scores(self.model, self.model.collect(detections))
        )


@dataclass(frozen=True)
class LinearWorld:
    """Objects seen in a few keyframes; ``names`` of the detections where identities are given."""

    model: LinearModel
    robot: GaussianPrior
    objects: tuple[GaussianPrior, ...]
    motions: tuple[Motion, ...]
    detections: tuple[tuple[LinearDetection, ...], ...]
    names: tuple[tuple[str, ...], ...] | None = None
    settings: ClosedWorldConfiguration = field(default_factory=ClosedWorldConfiguration)

    @property
    def num_classes(self) -> int:
        return self.model.num_classes

    @property
    def log_clutter(self) -> float:
        """Log odds of clutter times its density."""
        if self.names is None:
            return float(np.log(self.settings.clutter_per_frame) - np.log(AREA_M2))
        share = self.settings.wrong_identity_share
        return float(np.log(share / (1.0 - share)) - np.log(AREA_M2))


def by_engine(world: LinearWorld) -> tuple[dict, Array, float, list[Array]]:
    """Probability of every association history, class probabilities (O, C), log evidence, outlier probabilities."""
    engine = Engine.of_run(RUN, InProcessPool(1, _problem(world)), _problem(world))
    beliefs = [engine.process(_step(world, k)) for k in range(len(world.motions))]
    histories: dict[tuple, float] = defaultdict(float)
    for live in engine.live.values():
        histories[tuple(step.association for step in live.lineage)] += float(np.exp(live.log_weight))
    outliers = [belief.outlier_probability for belief in beliefs]
    return dict(histories), beliefs[-1].class_probabilities, engine.log_evidence, outliers


def by_enumeration(world: LinearWorld) -> tuple[dict, Array, float]:
    """What :func:`by_engine` tells, from a sum of Gaussian evidences over associations, classes and outliers."""
    logs: dict[tuple, list[float]] = defaultdict(list)
    by_class: dict[tuple[int, ...], list[float]] = defaultdict(list)
    count, num_classes = len(world.objects), max(world.num_classes, 1)
    choices = [list(_associations(world, k)) for k in range(len(world.motions))]
    for history in itertools.product(*choices):
        seen = [(k, i, n) for k, own in enumerate(history) for i, n in enumerate(own)]
        active = [item for item in seen if item[2] >= 0]
        clutter = sum(_clutter(world, k, i) for k, i, n in seen if n < 0)
        for classes in itertools.product(range(num_classes), repeat=count):
            for wrong in itertools.product(*([False, True] if world.num_classes else [False] for _ in active)):
                log = clutter - count * np.log(num_classes) + _evidence(world, active, classes, wrong)
                logs[history].append(log)
                by_class[classes].append(log)
    total = float(np.logaddexp.reduce([log for own in logs.values() for log in own]))
    found = {history: float(np.exp(np.logaddexp.reduce(own) - total)) for history, own in logs.items()}
    probabilities = np.zeros((count, world.num_classes))
    for classes, own in by_class.items():
        if world.num_classes:
            probabilities[np.arange(count), classes] += np.exp(np.logaddexp.reduce(own) - total)
    return found, probabilities, total


def _associations(world: LinearWorld, k: int):
    objects = range(-1, len(world.objects))
    for own in itertools.product(objects, repeat=len(world.detections[k])):
        known = [n for n in own if n >= 0]
        if world.names is None and len(set(known)) == len(known):
            yield own
        if world.names is not None and all(
            n < 0 or str(n) == name for n, name in zip(own, world.names[k], strict=True)
        ):
            yield own


def _clutter(world: LinearWorld, k: int, i: int) -> float:
    model, seen = world.model, world.model.collect([world.detections[k][i]])
    return world.log_clutter + (float(log_scores(model, seen)[0]) if world.num_classes else 0.0)


def _evidence(world: LinearWorld, active: Sequence[tuple[int, int, int]], classes, wrong) -> float:
    """Log evidence of the detections under one choice of everything: one Gaussian."""
    model, size = world.model, 2 * (1 + len(world.motions) + len(world.objects))
    mean, prior = np.zeros(size), np.zeros((size, size))
    to_states = np.eye(size)
    mean[:2], prior[:2, :2] = world.robot.mean, world.robot.covariance
    for k, motion in enumerate(world.motions):
        rows = slice(2 * (k + 1), 2 * (k + 2))
        mean[rows], prior[rows, rows] = motion.control, motion.covariance
        to_states[rows, : 2 * (k + 1)] = np.tile(np.eye(2), k + 1)
    first = 2 * (1 + len(world.motions))
    for n, own in enumerate(world.objects):
        rows = slice(first + 2 * n, first + 2 * n + 2)
        mean[rows], prior[rows, rows] = own.mean, own.covariance
    mean, prior = to_states @ mean, to_states @ prior @ to_states.T
    total, rows_of, residuals, noise = 0.0, [], [], []
    for (k, i, n), outlier in zip(active, wrong, strict=True):
        z, difference = world.detections[k][i], np.zeros((2, size))
        difference[:, 2 * (k + 1) : 2 * (k + 2)] = -np.eye(2)
        difference[:, first + 2 * n : first + 2 * n + 2] = np.eye(2)
        rows_of.append(difference)
        residuals.append(z.geo - difference @ mean)
        noise.append(model.geometric_covariance)
        if not world.num_classes:
            continue
        share = model.outliers.share
        if outlier:
            total += np.log(share) + float(log_scores(model, model.collect([z]))[0])
            continue
        total += np.log1p(-share)
        slope = model.slopes[classes[n]] @ difference
        rows_of.append(slope)
        residuals.append(z.sem - model.offsets[classes[n]] - slope @ mean)
        noise.append(model.semantic_covariance)
    if not rows_of:
        return float(total)
    jacobian, residual = np.concatenate(rows_of), np.concatenate(residuals)
    covariance = jacobian @ prior @ jacobian.T
    for at, own in enumerate(noise):
        covariance[2 * at : 2 * at + 2, 2 * at : 2 * at + 2] += own
    logdet = np.linalg.slogdet(2.0 * np.pi * covariance)[1]
    return float(total - 0.5 * (residual @ np.linalg.solve(covariance, residual) + logdet))


RUN = RunConfiguration(
    run_id="enumeration",
    stamp_ns=0,
    configuration="",
    map_prior="",
    initial_pose=np.zeros(7),
    initial_covariance=np.zeros((6, 6)),
    class_names=(),
)


def _problem(world: LinearWorld) -> Problem:
    names = tuple(f"class_{c}" for c in range(world.num_classes))
    prior = np.full(len(names), 1.0 / max(len(names), 1))
    entries = tuple(
        ObjectEntry(object_id=n, name=str(n), prior=own, class_prior=prior) for n, own in enumerate(world.objects)
    )
    robust = world.model if isinstance(world.model, RobustLinearModel) else None
    return Problem(
        spaces=Spaces.same(PlanarPositions()),
        model=world.model,
        reader=StepReader(),
        robot=world.robot,
        objects=entries,
        class_names=names,
        class_shares=prior,
        seed=0,
        association=EnumeratedAssociation if world.names is None else GivenAssociation,
        distinct=True,
        weights=WeightsConfiguration(
            gate=np.inf,
            max_candidates=10**9,
            max_associations=0,
            importance_samples=4096,
            importance_gate=np.inf,
            max_history=100,
        ),
        pruning=NO_PRUNING,
        clutter=LinearClutter(robust),
        closed_world=world.settings,
    )


def _step(world: LinearWorld, k: int) -> Step:
    count = len(world.detections[k])
    return Step(
        index=k,
        stamp_ns=(k + 1) * 10**9,
        motion=world.motions[k],
        detections=list(world.detections[k]),
        detection_ids=np.arange(count, dtype=np.uint32),
        scores=np.ones(count),
        names=("",) * count if world.names is None else world.names[k],
        in_coverage=np.ones(count, dtype=bool),
    )

"""A planar robot among points: two spaces of different sizes, with detections by range and bearing, or linear ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.configuration import Configuration, PruningConfiguration, WeightsConfiguration
from semantic_slam.geometry import se2
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.models.observation import Linearisation, ObservationModel
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.point_observation import POSES_AND_POINTS
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.problem import Problem

LOG_2PI = np.log(2.0 * np.pi)
EXACT = WeightsConfiguration(
    gate=np.inf,
    max_candidates=10**9,
    importance_samples=4096,
    importance_gate=np.inf,
    gaussian_share=0.9999,
    max_history=100,
)
"""Nothing is left out, and nothing counts as Gaussian that is not."""


@dataclass(frozen=True)
class StepReader:
    """Steps made by hand."""

    def step(self, keyframe: Step) -> Step:
        return keyframe


@dataclass(frozen=True)
class BodyPoints:
    """(B, 2) detections: positions in the body frame."""

    points: np.ndarray

    def take(self, index: Any) -> "BodyPoints":
        return BodyPoints(self.points[index])


@dataclass(frozen=True)
class BodyPointObservation:
    """z = R_x^T (o - t_x) + v: linear in all but the heading."""

    covariance: np.ndarray  # (2, 2)

    num_classes = 0
    spaces = POSES_AND_POINTS

    def collect(self, detections: Sequence[np.ndarray]) -> BodyPoints:
        return BodyPoints(np.array(detections).reshape(-1, 2))

    def geometry(self, seen: BodyPoints, x: np.ndarray, o: np.ndarray) -> Linearisation:
        relative = self.spaces.relative_position(x, o)
        whiten = np.linalg.inv(np.linalg.cholesky(self.covariance))
        residual = (relative.point - np.tile(seen.points, (len(x) // len(seen.points), 1))) @ whiten.T
        log_normaliser = np.full(len(x), -0.5 * np.linalg.slogdet(self.covariance)[1] - LOG_2PI)
        return Linearisation(
            residual=residual,
            jacobian_robot=whiten @ relative.by_robot,
            jacobian_object=whiten @ relative.by_landmark,
            log_normaliser=log_normaliser,
        )

    def semantics(self, seen, x, o, classes):
        raise NotImplementedError

    def log_likelihood(self, seen, x, o, classes):
        part = self.geometry(seen, x, o)
        return part.log_normaliser - 0.5 * (part.residual**2).sum(-1)

    def best_heading(self, seen, x, o, classes, sigma):
        raise NotImplementedError

    sees_everywhere = True

    def log_visibility(self, x, o, *, soft):
        return np.zeros(len(x))

    def robot_start(self, seen, x, o):
        start = x.copy()
        points = np.tile(seen.points, (len(x) // len(seen.points), 1))
        start[:, :2] = o - self.spaces.robot.displacement(x, points, x[:, :2])
        return start

    def object_prior(self, detection, x):
        point = self.spaces.robot.displacement(x, detection, np.zeros(2))
        return GaussianPrior(point, 1e6 * np.eye(2))

    def geometry_factor(self, detection, keys):
        seen = self.collect([detection])

        def error(this, values, jacobians):
            robot, landmark = this.keys()
            states = self.spaces.robot.state(values, robot), self.spaces.landmark.state(values, landmark)
            part = self.geometry(seen, *(state[None] for state in states))
            if jacobians is not None:
                jacobians[0] = np.asfortranarray(part.jacobian_robot[0])
                jacobians[1] = np.asfortranarray(part.jacobian_object[0])
            return part.residual[0]

        return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(2), list(keys), error)

    def bearing_sigma(self, x, o, covariance, charts):
        return np.zeros(len(x))

    def view_change(self, before, now):
        return np.zeros(len(before))

    def least_cost(self, seen, x, covariance, o, sigmas):
        return np.zeros((len(x), len(seen.points), o.shape[1])), 0.0


@dataclass(frozen=True)
class PointWorld:
    """Priors, motions and detections; what is estimated follows from these alone."""

    start: GaussianPrior  # of the robot
    points: np.ndarray  # (N, 2) prior means
    spread: np.ndarray  # (2, 2) of each
    motions: list[Motion]
    frames: list[list[Any]]  # detections of each keyframe
    model: ObservationModel
    association: str = "enumerated"
    names: tuple[str, ...] = ()  # of the detections, where the association is given
    weights: WeightsConfiguration = EXACT

    def problem(self) -> Problem:
        entries = tuple(
            ObjectEntry(object_id=n, name=f"point_{n}", prior=GaussianPrior(mean, self.spread), class_prior=np.zeros(0))
            for n, mean in enumerate(self.points)
        )
        return Problem(
            spaces=POSES_AND_POINTS,
            model=self.model,
            reader=StepReader(),
            robot=self.start,
            objects=entries,
            class_names=(),
            class_shares=np.zeros(0),
            seed=0,
            association=strategy_of(Configuration.of(association=self.association)),
            distinct=True,
            weights=self.weights,
            pruning=PruningConfiguration(ratio=np.inf, max_hypotheses=10**9),
        )

    def steps(self) -> list[Step]:
        return [
            Step(
                index=k,
                stamp_ns=(k + 1) * 10**9,
                motion=motion,
                detections=detections,
                detection_ids=np.arange(len(detections), dtype=np.uint32),
                scores=np.ones(len(detections)),
                names=self.names or ("",) * len(detections),
                in_coverage=np.ones(len(detections), dtype=bool),
            )
            for k, (motion, detections) in enumerate(zip(self.motions, self.frames, strict=True))
        ]


@dataclass(frozen=True)
class PointOutcome:
    """What the engine says; rows of the belief by association history."""

    belief: HybridBelief
    histories: list[tuple[tuple[int, ...], ...]]  # H
    log_evidence: float

    @property
    def weights(self) -> dict[tuple[tuple[int, ...], ...], float]:
        """Of each association history, its modes together."""
        found: dict[tuple[tuple[int, ...], ...], float] = {}
        for beta, weight in zip(self.histories, np.exp(self.belief.log_weights), strict=True):
            found[beta] = found.get(beta, 0.0) + float(weight)
        return found


def run_points(world: PointWorld, num_backends: int = 1) -> PointOutcome:
    """All keyframes through engine and backends, pruning off."""
    problem = world.problem()
    run = RunConfiguration(
        run_id="points",
        stamp_ns=0,
        configuration="",
        map_prior="",
        initial_pose=np.zeros(7),
        initial_covariance=np.zeros((6, 6)),
        class_names=(),
    )
    engine = Engine.of_run(run, InProcessPool(num_backends, problem), problem)
    for step in world.steps():
        belief = engine.process(step)
    histories = [tuple(step.association for step in live.lineage) for live in engine.live.values()]
    return PointOutcome(belief, histories, engine.log_evidence)


def drive(start: np.ndarray, motions: Sequence[Motion], random: np.random.Generator) -> list[np.ndarray]:
    """(K,) true poses along noisy motions."""
    x, found = start, []
    for motion in motions:
        x = se2.compose(
            se2.compose(x, motion.control), se2.exp(random.multivariate_normal(np.zeros(3), motion.covariance))
        )
        found.append(x)
    return found


def body_point(x: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(2,) a point as the robot sees it, written down by hand."""
    c, s = np.cos(x[2]), np.sin(x[2])
    return np.array([[c, s], [-s, c]]) @ (point - x[:2])


def range_bearing(point: np.ndarray, covariance: np.ndarray) -> PlanarDetection:
    """Of a (2,) point in the body frame."""
    none = np.zeros(0)
    direction = float(np.arctan2(point[1], point[0]))
    return PlanarDetection(
        range_m=float(np.hypot(*point)),
        bearing_rad=direction,
        covariance=covariance,
        sensor=np.zeros(2),
        feature=none,
        feature_covariance=np.zeros((0, 0)),
    )

"""A simulated run through the engine of the nodes, and what Fig. 4.5 asks of every keyframe."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from semantic_slam.configuration import PruningConfiguration, WeightsConfiguration
from semantic_slam.errors import SemanticSlamError
from semantic_slam.evaluation.mixture import heaviest_position_error, position_determinant, weighted_position_error
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE, PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.problem import Problem
from semantic_slam.registry import ASSOCIATIONS
from semantic_slam.viewpoint.parametric import ParametricModel
from semantic_slam_lab.prepared_steps import PreparedSteps
from semantic_slam_lab.studies.ch4.simulation import Frame, Run, features

History = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Method:
    """How the engine is asked: with which class models and which weights."""

    alpha: float | None  # of Eq. 4.22; None: no semantics (DA-BSP)
    weights: str = WeightsConfiguration().method  # "sampled": the thesis's samples of the prior

    @property
    def name(self) -> str:
        """Key of the method in results."""
        name = "no_semantics" if self.alpha is None else str(self.alpha)
        return name if self.weights == WeightsConfiguration().method else f"{name}_{self.weights}"


@dataclass(frozen=True)
class Moment:
    """The belief of one keyframe beside the truth."""

    log_weights: Array  # (H,)
    poses: Array  # (H, 7)
    pose_covariances: Array  # (H, 6, 6)
    associations: dict[History, float]  # beta_{1:k} -> P(beta_{1:k} | H_k), Eq. 4.8
    p_true_association: float
    confidence: float  # probability of the likeliest association history
    likeliest_is_true: bool
    association_entropy: float
    component_entropy: float
    det_position_covariance: float  # m^4
    error_max_weight_m: float
    error_weighted_m: float
    num_hypotheses: int
    discarded_mass: float
    seconds: float


@dataclass(frozen=True)
class Followed:
    """A run's moments; fewer than its keyframes when every hypothesis was lost."""

    moments: tuple[Moment, ...]
    fault: str  # why it was lost, "" when it was not


def follow(run: Run, method: Method, seed: int) -> Followed:
    """The beliefs of all keyframes of ``run``; ``seed`` is that of the engine's own draws."""
    problem = problem_of(run, method, seed)
    blank = RunConfiguration(
        run_id="chapter_4",
        stamp_ns=0,
        configuration="",
        map_prior="",
        initial_pose=np.zeros(7),
        initial_covariance=np.zeros((6, 6)),
        class_names=problem.class_names,
    )
    manager = Engine.of_run(blank, InProcessPool(1, problem), problem)
    moments: list[Moment] = []
    for k in range(len(run.frames)):
        keyframe, begun = Keyframe.planar(k), perf_counter()
        try:
            belief = manager.process(keyframe)
        except SemanticSlamError as fault:
            return Followed(tuple(moments), f"k = {k + 1}: {fault}")
        moments.append(_moment(run, k, belief, manager, perf_counter() - begun))
    return Followed(tuple(moments), "")


def problem_of(run: Run, method: Method, seed: int) -> Problem:
    """The run's priors and models with the engine's default settings."""
    scenario = run.scenario
    model = None if method.alpha is None else ParametricModel(method.alpha, scenario.concentration)
    class_names = () if model is None else model.class_names
    uniform = np.full(len(class_names), 1.0 / max(len(class_names), 1))
    covariance = np.diag(scenario.object_variance)
    return Problem(
        spaces=POSES_IN_PLANE,
        model=PlanarObservation(model, PlanarVisibility(scenario.max_range_m, scenario.field_of_view_rad)),
        reader=PreparedSteps([_step(run, k, frame, model) for k, frame in enumerate(run.frames)]),
        robot=GaussianPrior(scenario.start_mean, np.diag(scenario.start_variance)),
        objects=tuple(
            ObjectEntry(object_id=n, name=f"O{n + 1}", prior=GaussianPrior(mean, covariance), class_prior=uniform)
            for n, mean in enumerate(run.map_means)
        ),
        class_names=class_names,
        class_shares=uniform,
        seed=seed,
        association=ASSOCIATIONS.load("enumerated"),
        distinct=True,
        weights=WeightsConfiguration(method=method.weights),
        pruning=PruningConfiguration(),
    )


def _step(run: Run, k: int, frame: Frame, model: ParametricModel | None) -> Step:
    count = len(frame.seen)
    semantic = features(frame, model) if model is not None else np.zeros((count, 2))
    geometric = np.diag(run.scenario.range_bearing_variance)
    detections = [
        PlanarDetection(
            range_m=float(z[0]),
            bearing_rad=float(z[1]),
            covariance=geometric,
            sensor=np.zeros(2),
            feature=feature,
            feature_covariance=np.zeros((2, 2)),
        )
        for z, feature in zip(frame.range_bearing, semantic, strict=True)
    ]
    return Step(
        index=k,
        stamp_ns=(k + 1) * 10**9,
        motion=Motion(run.controls[k], np.diag(run.scenario.process_variance)),
        detections=detections,
        detection_ids=np.arange(count, dtype=np.uint32),
        scores=np.ones(count),
        names=("",) * count,
        in_coverage=np.ones(count, dtype=bool),
    )


def _moment(run: Run, k: int, belief: HybridBelief, manager: Engine, seconds: float) -> Moment:
    weights, truth = np.exp(belief.log_weights), run.poses[k]
    histories, true_history = association_marginal(manager), run.associations[: k + 1]
    likeliest = max(histories, key=lambda history: histories[history])
    return Moment(
        log_weights=belief.log_weights,
        poses=belief.poses,
        pose_covariances=belief.pose_covariances,
        associations=histories,
        p_true_association=histories.get(true_history, 0.0),
        confidence=histories[likeliest],
        likeliest_is_true=likeliest == true_history,
        association_entropy=belief.association_entropy,
        component_entropy=belief.component_entropy,
        det_position_covariance=position_determinant(weights, belief.pose_covariances),
        error_max_weight_m=heaviest_position_error(weights, belief.poses, truth),
        error_weighted_m=weighted_position_error(weights, belief.poses, truth),
        num_hypotheses=len(weights),
        discarded_mass=belief.discarded_mass,
        seconds=seconds,
    )


def association_marginal(manager: Engine) -> dict[History, float]:
    """P(beta_{1:k} | H_k): hypotheses that differ in classes or modes alone are summed."""
    found: dict[History, float] = {}
    for live in manager.live.values():
        history = tuple(step.association for step in live.lineage)
        found[history] = found.get(history, 0.0) + float(np.exp(live.log_weight))
    return found

"""Fixtures of chapter 4: weights and moments of every hypothesis are known exactly, and asked of the nodes' engine."""

import itertools
from dataclasses import dataclass

import numpy as np
from worlds.exact.linear_gaussian import LinearDetection, LinearModel, StepReader

from semantic_slam.configuration import PruningConfiguration, WeightsConfiguration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.planar_reader import PlanarReader
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.problem import Problem
from semantic_slam.registry import ASSOCIATIONS
from semantic_slam.viewpoint.parametric import ParametricModel

NO_PRUNING = PruningConfiguration(ratio=np.inf, max_hypotheses=10**9)


class StepPlanarReader(PlanarReader):
    """Steps made by hand, poses as in the nodes."""

    def step(self, keyframe: Step) -> Step:
        return keyframe


@dataclass(frozen=True)
class Outcome:
    """What the engine says of a fixture: its last belief, and every hypothesis with lazy classes expanded."""

    belief: HybridBelief
    hypotheses: dict[tuple, tuple[float, float]]  # (beta, C) -> (weight, log evidence)
    associations: dict[tuple, float]  # beta -> probability
    betas: list[tuple]  # of the belief's hypotheses, in its order


def run(data: dict, *, semantics: bool = True, method: str = "importance") -> Outcome:
    """Run a ``ch4_lg`` or ``ch4_se2`` fixture with pruning off."""
    problem, steps = _problem(data, semantics, method)
    run = RunConfiguration(
        run_id="fixture",
        stamp_ns=0,
        configuration="",
        map_prior="",
        initial_pose=np.zeros(7),
        initial_covariance=np.zeros((6, 6)),
        class_names=problem.class_names,
    )
    manager = Engine.of_run(run, InProcessPool(1, problem), problem)
    for step in steps:
        belief = manager.process(step)
    return _outcome(manager, belief, data["input"]["M"] if semantics else 0)


def _problem(data: dict, semantics: bool, method: str) -> tuple[Problem, list[Step]]:
    linear = data["schema"] == "exact-ch4-lg/1"
    given = data["input"]
    class_names = tuple(f"class_{c}" for c in range(given["M"])) if semantics else ()
    prior = np.full(len(class_names), 1.0 / max(len(class_names), 1))
    as_covariance = (lambda value: np.array(value)) if linear else (lambda value: np.diag(value))
    entries = tuple(
        ObjectEntry(
            object_id=i,
            name=str(i),
            prior=GaussianPrior(np.array(state), as_covariance(given["So"])),
            class_prior=prior,
        )
        for i, state in enumerate(given["objects"])
    )
    problem = Problem(
        spaces=Spaces.same(PlanarPositions() if linear else PlanarPoses()),
        model=_linear_model(given, len(class_names)) if linear else _planar_model(given, semantics),
        reader=StepReader() if linear else StepPlanarReader(0),
        robot=GaussianPrior(np.array(given["x0"]), as_covariance(given["Sp"])),
        objects=entries,
        class_names=class_names,
        class_shares=prior,
        seed=0,
        association=ASSOCIATIONS.load("enumerated"),
        distinct=given["exclusive"],
        weights=WeightsConfiguration(
            method=method,
            gate=np.inf,
            max_candidates=10**9,
            importance_samples=4096,
            importance_gate=np.inf,
            gaussian_share=0.9999,
            max_history=100,
        ),
        pruning=NO_PRUNING,
    )
    controls = [Motion(np.array(u), as_covariance(given["Sw"])) for u in given["u"]]
    return problem, [_step(k, *pair, given, linear) for k, pair in enumerate(zip(controls, given["Z"], strict=True))]


def _linear_model(given: dict, num_classes: int) -> LinearModel:
    return LinearModel(
        np.array(given["Sv"]), np.array(given["Ss"]), np.array(given["a"]), np.array(given["B"]), num_classes
    )


def _planar_model(given: dict, semantics: bool) -> PlanarObservation:
    model = ParametricModel(given["alpha"], given["Ksem"]) if semantics else None
    limited = given["rmax"] is not None
    return PlanarObservation(model, PlanarVisibility(given["rmax"] or 0.0, given["fov"] if limited else 0.0))


def _step(index: int, motion: Motion, frame: list[dict], given: dict, linear: bool) -> Step:
    if linear:
        detections = [LinearDetection(np.array(z["geo"]), np.array(z["sem"])) for z in frame]
    else:
        noise = np.diag(given["Sv"])
        detections = [
            PlanarDetection(
                range_m=z["geo"][0],
                bearing_rad=z["geo"][1],
                covariance=noise,
                sensor=np.zeros(2),
                feature=np.array(z["sem"]),
                feature_covariance=np.zeros((2, 2)),
            )
            for z in frame
        ]
    count = len(frame)
    return Step(
        index=index,
        stamp_ns=(index + 1) * 10**9,
        motion=motion,
        detections=detections,
        detection_ids=np.arange(count, dtype=np.uint32),
        scores=np.ones(count),
        names=("",) * count,
        in_coverage=np.ones(count, dtype=bool),
    )


def _outcome(manager: Engine, belief: HybridBelief, num_classes: int) -> Outcome:
    hypotheses: dict[tuple, tuple[float, float]] = {}
    associations: dict[tuple, float] = {}
    betas: list[tuple] = []
    num_objects = len(belief.object_ids)
    for row, live in enumerate(manager.live.values()):
        beta = tuple(step.association for step in live.lineage)
        betas.append(beta)
        weight = float(np.exp(live.log_weight))
        associations[beta] = associations.get(beta, 0.0) + weight
        if not num_classes:
            continue
        probabilities = belief.hypothesis_class_probabilities[row]
        for assignment in itertools.product(range(num_classes), repeat=num_objects):
            share = float(np.prod(probabilities[np.arange(num_objects), assignment]))
            if share > 0.0:
                log_evidence = live.log_weight + manager.log_evidence + np.log(share * num_classes**num_objects)
                before = hypotheses.get((beta, assignment), (0.0, -np.inf))  # of another mode
                hypotheses[beta, assignment] = (
                    before[0] + weight * share,
                    float(np.logaddexp(before[1], log_evidence)),
                )
    return Outcome(belief, hypotheses, associations, betas)

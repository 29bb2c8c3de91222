"""A keyframe of the engine at the end of a drive of 200 poses among 20 objects with descriptors."""

import time
from dataclasses import dataclass

import numpy as np

from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE, PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.semantics.descriptors.descriptor_views import DescriptorViews
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.problem import Problem
from semantic_slam.latent.model import DescriptorModel
from semantic_slam.registry import ASSOCIATIONS
from semantic_slam_lab.benchmarks.latent_update import DETECTIONS, OBJECTS, POSES, SIGMA_STEP, STEP, Circuit
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.prepared_steps import PreparedSteps

BUDGET_MS = 50.0
MEASURED = 20
"""Last keyframes of the drive."""


@dataclass(frozen=True)
class Drive:
    """The circuit with its sensors' noise, as a run of the engine."""

    circuit: Circuit
    steps: list[Step]
    problem: Problem

    @classmethod
    def of(cls, model: DescriptorModel, seed: int) -> "Drive":
        """Unknown association over a known map."""
        circuit = Circuit(model, seed)
        noise = np.random.default_rng(seed)
        motion = Motion(STEP, np.diag(np.full(3, SIGMA_STEP**2)))
        steps = []
        for k in range(POSES):
            detections, _ = circuit.seen[k]
            count = len(detections)
            ids, flags = np.arange(count, dtype=np.uint32), np.ones(count, dtype=bool)
            steps.append(
                Step(
                    index=k,
                    stamp_ns=k + 1,
                    motion=motion,
                    detections=detections,
                    detection_ids=ids,
                    scores=np.ones(count),
                    names=("",) * count,
                    in_coverage=flags,
                )
            )
        names = model.class_names
        uniform = np.full(len(names), 1.0 / max(len(names), 1))
        sigma = np.array([0.1, 0.1, 0.02])
        means = [se2.compose(o, se2.exp(noise.normal(size=3) * sigma)) for o in circuit.objects]
        priors = [GaussianPrior(mean, np.diag(sigma**2)) for mean in means]
        entries = tuple(
            ObjectEntry(object_id=n, name=str(n), prior=prior, class_prior=uniform) for n, prior in enumerate(priors)
        )
        observation = LatentObservation(model)
        start = se2.compose(circuit.poses[0], se2.inverse(STEP))
        problem = Problem(
            spaces=POSES_IN_PLANE,
            model=PlanarObservation(None, PlanarVisibility()),
            reader=PreparedSteps(steps),
            robot=GaussianPrior(start, np.diag([0.1, 0.1, 0.05]) ** 2),
            objects=entries,
            class_names=names,
            class_shares=uniform,
            seed=seed,
            association=ASSOCIATIONS.load("enumerated"),
            distinct=True,
            semantics=DescriptorViews(observation),
            latent=observation,
        )
        return cls(circuit, steps, problem)

    def manager(self) -> Engine:
        """Before the first keyframe."""
        pose, covariance = pose_vector_from_planar(self.problem.robot.mean), covariance_from_planar(np.eye(3))
        run = RunConfiguration(
            run_id="bench",
            stamp_ns=0,
            configuration="",
            map_prior="",
            initial_pose=pose,
            initial_covariance=covariance,
            class_names=self.problem.class_names,
        )
        return Engine.of_run(run, InProcessPool(1, self.problem), self.problem)


def drive(quick: bool, seed: int) -> list[Row]:
    """Median of the last keyframes: the whole of manager and backend."""
    model = load_latent_model(SemanticModelConfiguration(kind="latent"))
    assert model is not None
    return driven(model, seed)


def driven(model: DescriptorModel, seed: int) -> list[Row]:
    """Rows of the benchmark's drive with any descriptor model."""
    run = Drive.of(model, seed)
    manager, times = run.manager(), []
    for keyframe in [Keyframe.planar(k) for k in range(len(run.steps))]:
        begun = time.thread_time()
        manager.process(keyframe)
        times.append(time.thread_time() - begun)
    median = 1e3 * float(np.median(times[-MEASURED:]))
    how = (
        f"Engine.process with one backend in the same process, {OBJECTS} mapped objects, {DETECTIONS}"
        f" detections of unknown association, keyframes {POSES - MEASURED + 1} to {POSES}, descriptors of"
        f" {model.num_dimensions}; against the {BUDGET_MS:g} ms of the requirement"
    )
    return [Row("latent_keyframe", median, BUDGET_MS, "ms", median / BUDGET_MS, MEASURED, how)]

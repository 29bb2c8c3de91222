"""Time of the weight update per parent while the robot is lost: ours against Alg. 4.1, printed and vectorised."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.inference.building import problem_of
from semantic_slam.inference.expander import Expander
from semantic_slam.inference.smoothing.component import WeightedComponent
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.roots import closed_root
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.grid.run import keyframes_of, run_of
from semantic_slam_lab.grid.world import World, grid_world
from semantic_slam_lab.peers.literal_alg_4_1 import LiteralWeights
from semantic_slam_lab.peers.prior_samples import NUM_SAMPLES, Gaussian, candidates_of, separate_weights, shared_weights
from semantic_slam_lab.repetitions import keyed_generator

DETECTIONS = 3
PARENTS = 20
REPETITIONS, QUICK_REPETITIONS = 7, 3
LITERAL_CANDIDATES = 2
"""Candidates of the 960 that the printed loop is timed on: it is the same for every one."""


def weights(quick: bool, seed: int) -> list[Row]:
    """All parents of a backend in one batch, the peers parent by parent; in turn, medians per parent."""
    world = grid_world(seed, num_detections=DETECTIONS)
    random = keyed_generator("weights_time", seed)
    ours, robots = _prepared(world, random)
    objects, classes = candidates_of(DETECTIONS, len(world.object_means))
    picked = random.choice(len(objects), LITERAL_CANDIDATES, replace=False)
    literal = LiteralWeights(world, robots[0], random, NUM_SAMPLES)
    calls: dict[str, Callable[[], object]] = {
        "ours": ours,
        "shared": lambda: [shared_weights(world, robot, random) for robot in robots],
        "separate": lambda: separate_weights(world, robots[0], random),
        "literal": lambda: [literal.weight(objects[i].tolist(), classes[i].tolist()) for i in picked],
    }
    repetitions = QUICK_REPETITIONS if quick else REPETITIONS
    ours()
    times = {name: np.median(row) for name, row in _interleaved(calls, repetitions).items()}
    mine, shared = times["ours"] / PARENTS, times["shared"] / PARENTS
    printed = times["literal"] / LITERAL_CANDIDATES * len(objects)
    setting = (
        f"per parent, {DETECTIONS} detections of {len(world.object_means)} objects, two classes, robot lost by 10 m;"
        f" ours: {PARENTS} parents in one batch, marginals included; accuracy on such worlds: weights_total_variation_*"
    )
    per_candidate = f"{setting}; {NUM_SAMPLES} prior samples, vectorised,"
    rows = (
        (
            "weights_vs_literal",
            printed,
            f"{setting}; {len(objects)} x a loop of {NUM_SAMPLES} multivariate_normal draws",
        ),
        ("weights_vs_sampled", times["separate"], f"{per_candidate} drawn for every association as in Alg. 4.1"),
        ("weights_vs_shared_samples", shared, f"{per_candidate} drawn once per parent and shared by all associations"),
    )
    literal_how = f"; measured on {LITERAL_CANDIDATES} candidates and scaled"
    return [
        Row(
            name,
            mine * 1e3,
            peer * 1e3,
            "ms",
            peer / mine,
            repetitions,
            how + (literal_how if "literal" in name else ""),
        )
        for name, peer, how in rows
    ]


def _prepared(world: World, random: np.random.Generator) -> tuple[Callable[[], object], list[Gaussian]]:
    """Our weight update of ``PARENTS`` robots that are lost, each elsewhere; and where they are predicted to be."""
    problem = problem_of(run_of(world))
    registry = ObjectRegistry(problem.objects, problem.class_shares)
    expander = Expander(problem, problem.association(problem, registry))
    step = problem.reader.step(keyframes_of(world)[0])
    covariance = np.diag(world.noise.robot)
    means = se2.compose(world.truth[0], se2.exp(random.normal(size=(PARENTS, 3)) * np.sqrt(world.noise.robot)))
    priors = [GaussianPrior(mean, covariance) for mean in means]
    parents = [
        WeightedComponent(closed_root(dataclasses.replace(problem, robot=prior)), -np.log(PARENTS)) for prior in priors
    ]
    robots = [dataclasses.replace(world, robot_mean=mean).predicted_robot() for mean in means]
    return lambda: expander.expand(step, list(range(PARENTS)), parents), robots


def _interleaved(calls: dict[str, Callable[[], object]], repetitions: int) -> dict[str, list[float]]:
    """CPU seconds of this thread, one call of each in turn."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repetitions):
        for name, call in calls.items():
            start = time.thread_time()
            call()
            times[name].append(time.thread_time() - start)
    return times

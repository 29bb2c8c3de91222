"""Total variation of the association posterior to a reference, the robot lost by 10 m: ours, the thesis's sampler."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.benchmarks.weights_reference import Reference, reference_posterior, total_variation
from semantic_slam_lab.grid.run import keyframes_of, run_of
from semantic_slam_lab.grid.world import World, grid_world
from semantic_slam_lab.peers.prior_samples import NUM_SAMPLES, candidates_of, shared_weights
from semantic_slam_lab.repetitions import keyed_generator, repeat

SEEDS, ALIGNED_SEEDS, QUICK_SEEDS = 50, 10, 4
NUM_REFERENCE_SAMPLES = 2**20
MOST_JOBS = 2
DETECTIONS = 3


@dataclass(frozen=True)
class Errors:
    """Total variation to the reference in one world."""

    candidates: float  # our weights of all candidates
    belief: float  # our belief, pruned
    discarded: float  # mass that the belief says it has discarded
    thesis: float  # 1000 samples from the prior
    reference: Reference


def accuracy(quick: bool, seed: int) -> list[Row]:
    """Median and 90 % over worlds with random headings, and with objects that all look the same way."""
    jobs = min(os.cpu_count() or 1, MOST_JOBS)
    rows = []
    for aligned, count in ((False, SEEDS), (True, ALIGNED_SEEDS)):
        keys = [
            (seed * SEEDS + index, aligned, NUM_REFERENCE_SAMPLES) for index in range(QUICK_SEEDS if quick else count)
        ]
        rows += _rows(repeat(errors, keys, jobs, "weights"), aligned)
    return rows


def errors(seed: int, aligned: bool = False, num_samples: int = NUM_REFERENCE_SAMPLES) -> Errors:
    """Errors of the weights in one world, after one keyframe."""
    world = grid_world(seed, num_detections=DETECTIONS, aligned=aligned)
    reference = reference_posterior(world, seed, num_samples)
    candidates, belief, discarded = our_posteriors(world, reference)
    return Errors(
        candidates=total_variation(candidates, reference.probabilities),
        belief=total_variation(belief, reference.probabilities),
        discarded=discarded,
        thesis=thesis_error(world, reference, seed),
        reference=reference,
    )


def our_posteriors(world: World, reference: Reference) -> tuple[Array, Array, float]:
    """(B,) before pruning and (B,) as published, classes and modes added up, and the mass said to be discarded."""
    pool = _RecordingPool(1)
    belief = Engine.of_run(run_of(world), pool).process(keyframes_of(world)[0])
    (found,) = pool.candidates
    weights = np.exp(found.log_weights - np.logaddexp.reduce(found.log_weights))
    before = _added_up(found.associations, weights, reference)
    published = _added_up(belief.associations, np.exp(belief.log_weights), reference)
    return before, published, belief.discarded_mass


class _RecordingPool(InProcessPool):
    """Remembers what the backends answered last."""

    candidates: list[Candidates]

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        self.candidates = super().expand(keyframe)
        return self.candidates


def thesis_error(world: World, reference: Reference, seed: int) -> float:
    """Error of the thesis's samples from the prior; 1 where none explains the frame, so that there is no posterior."""
    objects, _ = candidates_of(len(world.frames[0].objects), len(world.object_means))
    psi = shared_weights(world, world.predicted_robot(), keyed_generator("thesis", seed))
    if psi.sum() == 0.0:
        return 1.0
    return total_variation(_added_up(objects, psi / psi.sum(), reference), reference.probabilities)


def _added_up(associations: NDArray[Any], weights: Array, reference: Reference) -> Array:
    index = {tuple(row): i for i, row in enumerate(reference.associations.tolist())}
    total = np.zeros(len(reference.associations))
    np.add.at(total, [index[tuple(row)] for row in associations.tolist()], weights)
    return total


def _rows(found: list[Errors], aligned: bool) -> list[Row]:
    ours, thesis = np.array([e.candidates for e in found]), np.array([e.thesis for e in found])
    beliefs, discarded = np.array([e.belief for e in found]), np.array([e.discarded for e in found])
    of_reference = [e.reference for e in found]
    own = np.array([r.error for r in of_reference])
    how = (
        f"total variation of the association posterior, {DETECTIONS} detections of 6 objects"
        f"{', all with the same heading' if aligned else ''}, robot lost by 10 m; ours: all candidates; peer:"
        f" {NUM_SAMPLES} samples from the prior, shared by all candidates; reference: at least"
        f" {min(r.num_samples for r in of_reference)} importance samples, effective sample size of the likely"
        f" associations {np.median([r.effective_sample_size for r in of_reference]):.3g} (median), its own error"
        f" {np.median(own):.2g} (median), {own.max():.2g} (largest)"
    )
    pruned = (
        f"{how}; ours after pruning, discarding {np.median(discarded):.2g} (median), {discarded.max():.2g} (largest)"
    )
    suffix = "_aligned" if aligned else ""
    rows = []
    for name, share in (("median", 0.5), ("p90", 0.9)):
        peer = float(np.quantile(thesis, share))
        for title, values, text in (("weights", ours, how), ("belief", beliefs, pruned)):
            mine = float(np.quantile(values, share))
            rows.append(Row(f"{title}_total_variation_{name}{suffix}", mine, peer, "1", mine / peer, len(found), text))
    return rows

"""One drive through Victoria Park with one method, in a process of its own so that its memory can be told."""

import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import (
    Configuration,
    InitialPoseConfiguration,
    OdometryConfiguration,
    OpenWorldConfiguration,
    PruningConfiguration,
    SemanticModelConfiguration,
    WeightsConfiguration,
)
from semantic_slam.errors import SemanticSlamError
from semantic_slam.evaluation.association import pair_score
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.smoothing.component import Component
from semantic_slam_lab.studies.victoria_park.data import Drive

FRONT_END = OpenWorldConfiguration(
    detection_probability=0.1,  # the file holds at most two trunks per scan
    clutter_per_frame=0.01,
    birth_density=0.003,  # 150 trunks on 5 hectares, to within a factor of a few
    field_of_view_rad=float(np.pi),
    min_range_m=4.0,
    max_range_m=21.0,
    occluder_radius_m=0.0,
    least_undetected_share=0.1,
    gate_sigma=4.0,
    max_joint_objects=5,
    iterate_updates=False,
    merge_position_m=0.5,
    merge_object_m=0.7,
    merge_keyframes=15,
    merge_ghosts=True,
)
"""Births, clutter and gates of every method; said before any label was looked at, and the same for all."""
NUM_HYPOTHESES = {"ours": 10, "joint_assignment": 1, "nearest_neighbour": 1}
NOISE_FACTORS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""On the odometry covariance that is given: a belief of several hypotheses chooses by evidence, the others cannot."""
ONE_TRUNK = {"189": "34", "179": "41", "756": "108"}
"""Numbers of the file that almost surely mean a trunk that has another number already: they lie 0.2 m apart."""


@dataclass(frozen=True)
class Outcome:
    """What one method made of one drive; K keyframes."""

    method: str
    metrics: dict[str, float]
    associations: list[tuple[int, ...]]  # (K,) of the best hypothesis at the end
    poses: Array  # (K, 3) smoothed, of that hypothesis
    milliseconds: Array  # (k,) of the run's only thread, for every keyframe
    hypotheses: NDArray[np.int_]  # (k,) kept after each
    log_evidence: float
    fault: str = ""  # why the run ended before its last keyframe


def configuration_of(method: str, max_hypotheses: int | None = None) -> Configuration:
    """Configuration with one front end for every method; they differ in how many hypotheses they keep."""
    return Configuration(
        association="nearest_neighbour" if method == "nearest_neighbour" else "open",
        semantic_model=SemanticModelConfiguration(kind="none"),
        open_world=FRONT_END,
        weights=WeightsConfiguration(gate=15.0, max_candidates=30),
        pruning=PruningConfiguration(max_hypotheses=max_hypotheses or NUM_HYPOTHESES[method]),
        initial_pose=InitialPoseConfiguration(sigma=(0.01, 0.01, 0.001)),
        odometry=OdometryConfiguration(estimate_bias=True, noise_factors=NOISE_FACTORS if method == "ours" else (1.0,)),
    )


class StudyPool(InProcessPool):
    """A backend whose components can be looked into."""

    def component(self, number: int) -> Component:
        """The component of a hypothesis."""
        return self._backends[0].held[number].component


def drive_with(method: str, drive: Drive, max_hypotheses: int | None = None) -> Outcome:
    """Run ``method`` over the drive; a run that loses every hypothesis ends early and says so."""
    configuration = configuration_of(method, max_hypotheses)
    pose, covariance = initial_pose_of(configuration)
    pool = StudyPool(1)
    manager = Engine.of_run(make_run_configuration(configuration, None, pose, covariance, stamp_ns=1), pool)
    seconds, kept, fault = [], [], ""
    merged, candidates, wall_s = 0, 0, 0.0
    for keyframe in drive.keyframes:
        begin, wall = time.thread_time(), time.perf_counter()
        try:
            belief = manager.process(keyframe)
        except SemanticSlamError as error:
            fault = str(error)
            break
        seconds.append(time.thread_time() - begin)
        wall_s += time.perf_counter() - wall
        kept.append(len(belief.hypothesis_ids))
        merged, candidates = merged + belief.num_merged, candidates + belief.num_candidates
    best = max(manager.live, key=lambda n: (manager.live[n].log_weight, -n))
    associations = [step.association for step in manager.live[best].lineage]
    component = pool.component(best)
    assert component.tracked is not None
    heading_bias = float(component.tracked.bias[0]) * configuration.odometry.sigma_bias_rad_per_m
    metrics = {
        **scores(associations, drive.labels),
        "n_landmarks": float(len({n for own in associations for n in own})),
        "noise_factor": component.noise_settings.odometry_factor if component.noise_settings is not None else 1.0,
        "heading_bias_rad_per_m": heading_bias,
        "n_landmarks_in_belief": float((component.objects.existence > 0.5).sum()),
        **_times(np.array(seconds), drive.duration_s * len(seconds) / len(drive.keyframes)),
        "wall_s": wall_s,
        "hypotheses_mean": float(np.mean(kept)),
        "hypotheses_max": float(np.max(kept)),
        "candidates_mean": candidates / len(seconds),
        "merged": float(merged),
        "discarded_mass": float(belief.discarded_mass),
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }
    poses = smoothed_poses(component)
    milliseconds = 1e3 * np.array(seconds)
    return Outcome(method, metrics, associations, poses, milliseconds, np.array(kept), manager.log_evidence, fault)


def smoothed_poses(component: Component) -> Array:
    """(K, 3) planar poses of all keyframes."""
    from semantic_slam.inference.states.keys import robot_key

    keys = [robot_key(keyframe) for keyframe in range(component.keyframe + 1)]
    return component.states(keys)


def scores(associations: Sequence[tuple[int, ...]], labels: Sequence[tuple[str, ...]]) -> dict[str, float]:
    """Pairwise scores against the file's numbers, and against those with the doubtful pairs made one."""
    known = labels[: len(associations)]
    estimate = [number for own in associations for number in own]
    found, merged = (pair_score(estimate, _numbers(own)) for own in (known, one_trunk(known)))
    return {
        "association_f1": found.f1,
        "association_f1_merged": merged.f1,
        "association_precision_merged": merged.precision,
        "association_recall_merged": merged.recall,
    }


def one_trunk(labels: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The file's numbers of a drive with :data:`ONE_TRUNK` made one."""
    return [tuple(ONE_TRUNK.get(name, name) for name in own) for own in labels]


def _numbers(labels: Sequence[tuple[str, ...]]) -> list[int]:
    """Each label as a number, the first seen being 0."""
    number: dict[str, int] = {}
    return [number.setdefault(name, len(number)) for own in labels for name in own]


def _times(seconds: Array, duration_s: float) -> dict[str, float]:
    p50, p95, longest = (1e3 * float(value) for value in np.percentile(seconds, [50, 95, 100]))
    return {
        "ms_per_keyframe_p50": p50,
        "ms_per_keyframe_p95": p95,
        "ms_per_keyframe_max": longest,
        "seconds": float(seconds.sum()),
        "real_time_factor": duration_s / float(seconds.sum()),
    }

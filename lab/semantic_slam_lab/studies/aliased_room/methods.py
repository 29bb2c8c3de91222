"""One drive through a room without a map, with one method; births, clutter and misses are one front end for all."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import (
    Configuration,
    InitialPoseConfiguration,
    OpenWorldConfiguration,
    PruningConfiguration,
    SemanticModelConfiguration,
    WeightsConfiguration,
)
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.geometry.pose import (
    covariance_from_planar,
    planar_from_covariance,
    planar_from_pose_vector,
    pose_vector_from_planar,
)
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam_lab.studies.aliased_room.data import Rates, Recording
from semantic_slam_lab.studies.victoria_park.methods import StudyPool, smoothed_poses

START_SIGMA = (0.01, 0.01, 0.01)
"""Standard deviations of the initial x, y [m] and yaw [rad]: map is where the robot starts."""
CUT_OFF_SHARE = 0.1
"""Share of the objects inside the region that the camera cuts off and the detector leaves out."""
FIRST_SIGHT_DENSITY = 0.02
"""Objects per square metre not seen yet: few enough that a single detection leaves an existence below one half."""
MAX_HYPOTHESES = {"ours": 60, "max_mixture": 1, "no_semantics": 60, "nearest_neighbour": 1}


@dataclass(frozen=True)
class Outcome:
    """What one method made of one drive; K keyframes, O objects with any existence at the end, C classes."""

    method: str
    associations: list[tuple[int, ...]]  # (K,) of the best hypothesis at the end
    poses: Array  # (K, 3) smoothed, of that hypothesis
    filtered: Array  # (K, 3) mean at each keyframe, of all hypotheses
    covariances: Array  # (K, 3, 3) along the axes of map, of all hypotheses
    object_ids: NDArray[np.int_]  # (O,)
    objects: Array  # (O, 2) [m]
    existence: Array  # (O,)
    class_names: tuple[str, ...]
    classes: Array  # (O, C)
    seconds: Array  # (K,)
    hypotheses: NDArray[np.int_]  # (K,)
    discarded_mass: float
    fault: str = ""


def front_end(alarms: float, misses: float) -> OpenWorldConfiguration:
    """The region in which this camera and detector find furniture; rates as they are."""
    return OpenWorldConfiguration(
        detection_probability=(1.0 - misses) * (1.0 - CUT_OFF_SHARE),
        clutter_per_frame=alarms,
        birth_density=FIRST_SIGHT_DENSITY,
        field_of_view_rad=1.3,
        min_range_m=0.8,
        max_range_m=4.6,
        occluder_radius_m=0.4,
    )


def configuration_of(method: str, alarms: float, misses: float) -> Configuration:
    """Methods differ in what they know of classes and in how many hypotheses they keep."""
    with_classes = method in ("ours", "max_mixture")
    return Configuration(
        association="nearest_neighbour" if method == "nearest_neighbour" else "open",
        semantic_model=SemanticModelConfiguration(kind="gp_independent" if with_classes else "none"),
        open_world=front_end(alarms, misses),
        weights=WeightsConfiguration(max_candidates=100),
        pruning=PruningConfiguration(max_hypotheses=MAX_HYPOTHESES[method]),
        initial_pose=InitialPoseConfiguration(sigma=START_SIGMA),
    )


def drive_with(method: str, drive: Recording, rates: Rates, alarms: float) -> Outcome:
    """Run an engine over the drive; a run that loses every hypothesis ends early and says so."""
    configuration = configuration_of(method, alarms, rates.misses)
    pool = StudyPool(1)
    pose, covariance = pose_vector_from_planar(drive.truth[0]), covariance_from_planar(np.diag(START_SIGMA) ** 2)
    manager = Engine.of_run(make_run_configuration(configuration, None, pose, covariance, stamp_ns=1), pool)
    beliefs: list[HybridBelief] = []
    seconds, fault = [], ""
    for keyframe in drive.keyframes:
        begin = time.thread_time()
        try:
            beliefs.append(manager.process(keyframe))
        except SemanticSlamError as error:
            fault = str(error)
            break
        seconds.append(time.thread_time() - begin)
    return _outcome(method, manager, pool, beliefs, np.array(seconds), fault)


def _outcome(
    method: str,
    manager: Engine,
    pool: StudyPool,
    beliefs: list[HybridBelief],
    seconds: Array,
    fault: str,
) -> Outcome:
    best = max(manager.live, key=lambda n: (manager.live[n].log_weight, -n))
    moments = [matched_moments(np.exp(b.log_weights), b.poses, b.pose_covariances) for b in beliefs]
    last = beliefs[-1]
    return Outcome(
        method=method,
        associations=[step.association for step in manager.live[best].lineage],
        poses=smoothed_poses(pool.component(best)),
        filtered=np.array([planar_from_pose_vector(pose) for pose, _ in moments]),
        covariances=np.array([planar_from_covariance(spread) for _, spread in moments]),
        object_ids=last.object_ids.astype(int),
        objects=last.object_poses[:, :2],
        existence=last.existence,
        class_names=last.class_names,
        classes=last.class_probabilities,
        seconds=seconds,
        hypotheses=np.array([len(belief.hypothesis_ids) for belief in beliefs]),
        discarded_mass=float(last.discarded_mass),
        fault=fault,
    )

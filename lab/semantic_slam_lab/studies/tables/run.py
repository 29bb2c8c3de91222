"""One flight over tables: what was found, what was taken for what, and how far errors are those that were stated."""

import time
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import Configuration, from_dict, load_configuration, to_dict
from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.belief_views import ObjectEstimate
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.shipped import CONFIGURATIONS
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.simulation.tables import NAMES, OTHERS, Flight, TableTops, table_tops

EXISTS = 0.5
NEAR_M = 0.15
"""From the true place, up to which an object is found."""
START_SIGMA = 0.01
"""Metres and radians of each of the six, at the first keyframe."""


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of one flight."""

    seed: int
    seen: int  # things that were detected twice at least
    found: int  # of these
    false: int  # objects that are none of them, or one twice
    named_right: int  # of those found
    associated: float  # share of the detections of things that the heaviest history has with the right one
    pose_nees: float  # of 6 degrees of freedom, at the end
    object_nees: float  # of 3, of one object that is found
    odometry_m: float  # root mean square error of positions, of odometry alone
    error_m: float  # and of what is estimated, keyframe by keyframe
    cpu_s: float
    slowest_s: float


def configuration() -> Configuration:
    """The shipped one, for the detector's names."""
    values = to_dict(load_configuration(CONFIGURATIONS / "spatial.yaml"))
    values["semantic_model"]["labels"] = [*NAMES, *OTHERS]
    return from_dict(values, "study")


def flown(seed: int, flight: Flight) -> Flown:
    """Draw a room, fly, compare."""
    random, own = keyed_generator("tables", seed), configuration()
    room = table_tops(flight, SpatialRegion.of(own.open_world), random)
    start = se3.retract(room.truth[0], START_SIGMA * random.normal(size=6))
    covariance = START_SIGMA**2 * np.eye(6)
    engine = Engine(own, initial_pose=start, initial_covariance=covariance)
    spent, errors, drifts, odometry = list[float](), list[float](), list[float](), start
    for k, keyframe in enumerate(room.keyframes):
        begin = time.process_time()
        belief = engine.process(keyframe)
        spent.append(time.process_time() - begin)
        odometry = se3.compose(odometry, keyframe.odometry)
        errors.append(float(np.linalg.norm(belief.poses[0, :3] - room.truth[k, :3])))
        drifts.append(float(np.linalg.norm(odometry[:3] - room.truth[k, :3])))
    history = [step.association for step in next(iter(engine.live.values())).lineage]
    told = compared(seed, room, belief, history)
    return replace(
        told,
        odometry_m=float(np.sqrt(np.mean(np.square(drifts)))),
        error_m=float(np.sqrt(np.mean(np.square(errors)))),
        cpu_s=sum(spent),
        slowest_s=max(spent),
    )


def compared(seed: int, room: TableTops, belief: HybridBelief, history: list[tuple[int, ...]]) -> Flown:
    """A belief at the end with the truth; an object is the thing that most of its detections are of."""
    pairs = [pair for own, true in zip(history, room.seen, strict=True) for pair in zip(own, true, strict=True)]
    times = np.bincount([true for _, true in pairs if true >= 0], minlength=len(room.things))
    reported = [item for item in belief.objects if item.existence > EXISTS]
    owner = {item.object_id: _owner(item.object_id, pairs) for item in reported}
    taken: dict[int, int] = {}
    for item in reported:
        n = owner[item.object_id]
        if n >= 0 and n not in taken and np.linalg.norm(item.position - room.things[n]) < NEAR_M:
            taken[n] = item.object_id
    by_id = {item.object_id: item for item in reported}
    right = sum(true >= 0 and own == taken.get(true, -1) for own, true in pairs)
    off = se3.log(se3.between(belief.poses[0], room.truth[-1]))
    spread = se3.covariance_at_pose(belief.poses[0], belief.pose_covariances[0])
    first = min(taken, default=None)
    return Flown(
        seed=seed,
        seen=int((times >= 2).sum()),
        found=sum(bool(times[n] >= 2) for n in taken),
        false=len(reported) - len(taken),
        named_right=sum(by_id[own].likeliest_class == room.names[n] for n, own in taken.items()),
        associated=right / max(sum(true >= 0 for _, true in pairs), 1),
        pose_nees=float(off @ np.linalg.solve(spread, off)),
        object_nees=np.nan if first is None else _nees(by_id[taken[first]], room.things[first]),
        odometry_m=np.nan,
        error_m=np.nan,
        cpu_s=np.nan,
        slowest_s=np.nan,
    )


def _owner(object_id: int, pairs: list[tuple[int, int]]) -> int:
    """The thing that most detections of an object are of; -1: false alarms."""
    of = [true for own, true in pairs if own == object_id]
    return max(set(of), key=of.count) if of else -1


def _nees(item: ObjectEstimate, truth: Array) -> float:
    off = item.position - truth
    return float(off @ np.linalg.solve(item.covariance[:3, :3], off))

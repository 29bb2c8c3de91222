"""A camera that is put down metres from where it thinks, facing any way, over tables that are on its map."""

import time
from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import Configuration, from_dict, to_dict
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.simulation.tables import Flight, TableTops, table_tops
from semantic_slam_lab.studies.tables.run import configuration

LOST_M, HEIGHT_M, GRAVITY_RAD, ANY_YAW_RAD = 3.0, 0.3, 0.01, 1.8
"""Standard deviations of the first pose: along x and y, of its height, of roll and pitch, and of yaw, which is any."""
MAP_SIGMA_M = 0.02
KEYFRAMES = 15
RIGHT_M = 0.3


@dataclass(frozen=True, kw_only=True)
class Settled:
    """What came of one start."""

    seed: int
    off_m: float  # of the guess
    right: float  # weight of the hypotheses within ``RIGHT_M`` of the truth, at the end
    wrong: float  # most weight of one that is elsewhere, after any keyframe
    error_m: float  # of the heaviest, at the end
    cpu_s: float
    slowest_s: float

    @property
    def is_right(self) -> bool:
        return self.right > 0.5


def on_map(*, named: bool) -> Configuration:
    """The configuration with a map, of things that are called something, or of look-alikes."""
    values = to_dict(configuration())
    values["association"] = "enumerated"
    values["pruning"] |= {"max_hypotheses": 50}  # as docs/space.md has it for a camera that is lost
    if not named:
        values["semantic_model"] |= {"kind": "none", "labels": []}
    return from_dict(values, "study")


def lost(seed: int, named: bool, flight: Flight) -> Settled:
    """Draw a room, a guess and a map of it, fly on."""
    random, own = keyed_generator("tables", "lost", seed), on_map(named=named)
    room = table_tops(flight, SpatialRegion.of(own.open_world), random)
    guess = guessed(room, random)
    sigmas = np.array([LOST_M, LOST_M, HEIGHT_M, GRAVITY_RAD, GRAVITY_RAD, ANY_YAW_RAD])
    prior = drawn_map(room, random, named=named)
    engine = Engine(own, prior, initial_pose=guess, initial_covariance=np.diag(sigmas**2))
    spent, wrong = list[float](), 0.0
    for k, keyframe in enumerate(room.keyframes[:KEYFRAMES]):
        begin = time.process_time()
        belief = engine.process(keyframe)
        spent.append(time.process_time() - begin)
        off, weights = np.linalg.norm(belief.poses[:, :3] - room.truth[k, :3], axis=1), np.exp(belief.log_weights)
        wrong = max(wrong, float(weights[off >= RIGHT_M].max(initial=0.0)))
    return Settled(
        seed=seed,
        off_m=float(np.linalg.norm(guess[:3] - room.truth[0, :3])),
        right=float(weights[off < RIGHT_M].sum()),
        wrong=wrong,
        error_m=float(off[0]),
        cpu_s=sum(spent),
        slowest_s=max(spent),
    )


def guessed(room: TableTops, random: np.random.Generator) -> Array:
    """(7,) first pose, off by the stated standard deviations and any yaw along the axes of map."""
    away = random.normal(size=3) * [LOST_M, LOST_M, HEIGHT_M]
    yaw = so3.exp(np.array([0.0, 0.0, random.uniform(-np.pi, np.pi)]))
    tilt = so3.exp(np.append(GRAVITY_RAD * random.normal(size=2), 0.0))
    return np.append(room.truth[0, :3] + away, so3.product(tilt, so3.product(yaw, room.truth[0, 3:])))


def drawn_map(room: TableTops, random: np.random.Generator, *, named: bool) -> MapPrior:
    """The things, each place off by the standard deviation that the map states."""
    places = room.things + MAP_SIGMA_M * random.normal(size=room.things.shape)
    spread = np.diag([*[MAP_SIGMA_M**2] * 3, 0.0, 0.0, 0.0])
    objects = [
        ObjectPrior(
            object_id=n,
            name=str(n),
            pose=np.array([*place, 0.0, 0.0, 0.0, 1.0]),
            covariance=spread,
            class_probabilities={room.names[n]: 1.0} if named else {},
        )
        for n, place in enumerate(places)
    ]
    return MapPrior(tuple(objects))

"""The null model beside a known map with clutter has the integral of the belief's density, and so no false alarms."""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.reference.assignment_count import log_num_assignments
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

PLACES = np.array([[10.0, 5.0], [8.0, -6.0]])
SIGMA_PLACE, SIGMA_RANGE, SIGMA_BEARING = 0.2, 0.3, 0.03
REACH, DETECTIONS = 50.0, 3


@pytest.mark.parametrize("distinct", [True, False])
@pytest.mark.parametrize("clutter", [0.0, 0.3])
@pytest.mark.parametrize(("num_mapped", "unmapped"), [(3, []), (1, [0.2, 0.7]), (0, [0.4, 1.0, 0.1])])
def test_assignments_are_counted_as_they_are_weighed(
    num_mapped: int, unmapped: list[float], clutter: float, distinct: bool
) -> None:
    """Every assignment written out; an object that the map may lack costs its existence probability once."""
    existence = [1.0] * num_mapped + unmapped
    for n in range(4):
        expected = 0.0
        for assigned in product(range(-1, len(existence)), repeat=n):
            seen = [own for own in assigned if own >= 0]
            if not distinct or len(set(seen)) == len(seen):
                expected += clutter ** assigned.count(-1) * math.prod(existence[own] for own in set(seen))
        found = log_num_assignments(n, num_mapped, np.array(unmapped), clutter, distinct)
        assert np.exp(found) == pytest.approx(expected, rel=1e-12)


@dataclass(frozen=True)
class Room:
    """A map of two objects that may lack one or have it elsewhere, and what a robot at rest sees of it."""

    clutter: float = 3.0
    existence: float = 1.0  # of each object of the map
    displaced_share: float = 0.0

    def log_ratios(self, seed: int, keyframes: int) -> list[float]:
        """Log of the null model's density over the belief's, of each keyframe under a right model."""
        random = np.random.default_rng(seed)
        robot = np.array([0.3, 0.3, 0.05]) * random.normal(size=3)
        objects = PLACES + SIGMA_PLACE * random.normal(size=PLACES.shape)
        objects += (random.uniform(size=(2, 1)) < self.displaced_share) * random.normal(size=PLACES.shape)
        engine = Engine(
            self._configuration(),
            self._map(),
            initial_pose=np.zeros(3),
            initial_covariance=np.diag([0.3, 0.3, 0.05]) ** 2,
        )
        for k in range(keyframes):
            seen = self._frame(robot, objects, random)
            engine.process(Keyframe.planar(k, detections=seen, motion_sigmas=(1e-3, 1e-3, 1e-3)))
        return list(engine.model_fit.lately)

    def _frame(self, robot: Array, objects: Array, random: np.random.Generator) -> list[Detection]:
        """The detections of a first keyframe, whose assignment is drawn by the weights that a belief gives to all."""
        assigned = [own for own in product(range(-1, 2), repeat=DETECTIONS) if own.count(0) < 2 and own.count(1) < 2]
        weights = np.array(
            [self.clutter ** own.count(-1) * self.existence ** (len(own) - own.count(-1)) for own in assigned]
        )
        found = []
        for number in assigned[random.choice(len(assigned), p=weights / weights.sum())]:
            if number < 0:
                found.append((REACH * np.sqrt(random.uniform()), random.uniform(-np.pi, np.pi)))
            else:
                x, y = objects[number] - robot[:2]
                range_m, bearing = np.array([np.hypot(x, y), np.arctan2(y, x) - robot[2]])
                found.append((range_m + SIGMA_RANGE * random.normal(), bearing + SIGMA_BEARING * random.normal()))
        return [Detection(range_m=range_m, bearing_rad=bearing) for range_m, bearing in found]

    def _map(self) -> MapPrior:
        priors = (
            ObjectPrior.planar(n, *at, sigma_m=SIGMA_PLACE, sigma_rad=0.1, existence=self.existence)
            for n, at in enumerate(PLACES)
        )
        return MapPrior(tuple(priors))

    def _configuration(self) -> Configuration:
        return Configuration.of(
            semantic_model={"kind": "none"},
            closed_world={"clutter_per_frame": self.clutter, "displaced_share": self.displaced_share},
            visibility={"max_range_m": REACH},
            open_world={"max_range_m": REACH, "field_of_view_rad": 2.0 * np.pi, "min_range_m": 0.0},
            perception={"sigma_range_m": SIGMA_RANGE, "sigma_bearing_rad": SIGMA_BEARING},
            weights={"method": "laplace"},
        )


@pytest.mark.long
@pytest.mark.parametrize(
    ("room", "worlds", "keyframes"),
    [(Room(), 60, 4), (Room(clutter=0.3, existence=0.3, displaced_share=0.05), 250, 1)],
)
def test_the_ratio_of_the_densities_is_one_on_average_under_a_right_model(
    room: Room, worlds: int, keyframes: int
) -> None:
    """A martingale, which bounds the false alarms: the mean of the ratio within four standard errors of 1."""
    ratios = np.exp([room.log_ratios(seed, keyframes) for seed in range(worlds)]).ravel()
    error = ratios.std() / np.sqrt(len(ratios))
    assert error < 0.35
    assert ratios.mean() == pytest.approx(1.0, abs=4.0 * error)

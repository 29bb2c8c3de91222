"""A robot that drives past one object, and the smoother that each step extends."""

from dataclasses import replace

import gtsam
import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.batch_update import Extension, update_all
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.semantic_factors import (
    SemanticFactor,
    SemanticFactorMaker,
)
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.viewpoint.parametric import ParametricModel

MANIFOLD = PlanarPoses()
SPACES = Spaces.same(MANIFOLD)
CLASSES = PlanarObservation(ParametricModel(0.25, 10.0), PlanarVisibility())
GEOMETRY = PlanarObservation(None, PlanarVisibility())
ROBOT = [gtsam.symbol("x", k) for k in range(10)]
TARGET, LOOK = gtsam.symbol("o", 0), gtsam.symbol("e", 0)
OBJECT = np.array([2.0, 0.3, 1.0])
STEP, STEP_SIGMA = np.array([0.2, 0.0, 0.15]), 0.03


def extend(smoother: Smoother, extension: Extension) -> Smoother:
    """One alone."""
    found = update_all([smoother], [extension])[0]
    if isinstance(found, LostComponentError):
        raise found
    return found


def root(semantics: SemanticFactorMaker) -> Smoother:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key, mean, sigma in ((ROBOT[0], np.zeros(3), 0.1), (TARGET, OBJECT, 0.1)):
        graph.add(MANIFOLD.prior_factors(key, mean, sigma**2 * np.eye(3))[0])
        MANIFOLD.insert(values, key, mean)
    return Smoother.of(SPACES, semantics, graph, values)


def detection(x: np.ndarray, feature: np.ndarray) -> PlanarDetection:
    d = se2.between(x, OBJECT)
    size = len(feature)
    noise = np.diag([0.1, 0.05]) ** 2
    spread = 0.01 * np.eye(size) if size == 2 else np.zeros((size, size))
    return PlanarDetection(
        range_m=np.hypot(*d[:2]),
        bearing_rad=np.arctan2(d[1], d[0]),
        covariance=noise,
        sensor=np.zeros(2),
        feature=feature,
        feature_covariance=spread,
    )


def step(k: int, measurements: list[SemanticFactor], seen: PlanarDetection, guess: np.ndarray) -> Extension:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(MANIFOLD.between_factor(ROBOT[k], ROBOT[k + 1], STEP, STEP_SIGMA**2 * np.eye(3)))
    graph.add(CLASSES.geometry_factor(seen, (ROBOT[k + 1], TARGET)))
    MANIFOLD.insert(values, ROBOT[k + 1], guess)
    return Extension(graph=graph, values=values, measurements=measurements, start={ROBOT[k + 1]: guess, TARGET: OBJECT})


def classed(k: int, offset: float, jumped: bool = False) -> Extension:
    x = path(k + 1)
    seen = detection(x, np.array([0.3 + offset, 0.2]))
    extension = step(
        k,
        [SemanticFactor(robot_key=ROBOT[k + 1], object_key=TARGET, detection=seen, assigned_class=0)],
        seen,
        se2.compose(x, np.array([offset, 0.0, 0.0])),
    )
    return replace(extension, jumped=jumped)


def path(length: int) -> np.ndarray:
    x = np.zeros(3)
    for _ in range(length):
        x = se2.compose(x, STEP)
    return x


def estimate(smoother: Smoother) -> np.ndarray:
    return MANIFOLD.states(smoother.isam.calculateEstimate())


def num_real_factors(smoother: Smoother) -> int:
    graph = smoother.isam.getFactorsUnsafe()
    return sum(graph.exists(i) for i in range(graph.size()))

"""A short drive past objects of which a map is saved: places known by their common start alone."""

import numpy as np

from semantic_slam.configuration import Configuration, SemanticModelConfiguration
from semantic_slam.geometry import se2
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.from_run import saved_map_of_engine
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.saved_map import SavedMap

PLACES = np.array([[2.0, 1.0], [3.0, -1.0], [4.0, 1.5], [5.0, -0.5]])
LOOSE = MapPrior(tuple(ObjectPrior.planar(n, x, y, sigma_m=3.0, sigma_rad=0.3) for n, (x, y) in enumerate(PLACES)))
GIVEN = Configuration(association="given", semantic_model=SemanticModelConfiguration(kind="none"))
STEP = np.array([0.4, 0.0, 0.05])


def keyframes(places: np.ndarray = PLACES, count: int = 6) -> list[Keyframe]:
    """Keyframes with all objects in view, by name, and measured without error."""
    pose, told = np.zeros(3), []
    for index in range(count):
        pose = se2.compose(pose, STEP) if index else pose
        off = se2.between(np.broadcast_to(pose, (len(places), 3)), np.column_stack([places, np.zeros(len(places))]))
        seen = [
            Detection(
                range_m=float(np.hypot(*point[:2])),
                bearing_rad=float(np.arctan2(point[1], point[0])),
                track_id=f"object_{number}",
            )
            for number, point in enumerate(off)
        ]
        motion = STEP if index else np.zeros(3)
        told.append(Keyframe.planar(index, motion=motion, detections=seen, motion_sigmas=np.array([0.03, 0.03, 0.01])))
    return told


def run_to_its_end(prior: MapPrior = LOOSE) -> tuple[Engine, HybridBelief]:
    """An engine at the end of that drive, with its backend in this process, and its last belief."""
    engine = Engine(GIVEN, prior, initial_covariance=np.diag([0.3, 0.3, 0.1]) ** 2)
    beliefs = [engine.process(keyframe) for keyframe in keyframes()]
    return engine, beliefs[-1]


def small_map(prior: MapPrior = LOOSE) -> SavedMap:
    """The map at the end of that drive."""
    engine, belief = run_to_its_end(prior)
    assert isinstance(engine.pool, InProcessPool)
    return with_id(saved_map_of_engine(engine, engine.pool, belief))

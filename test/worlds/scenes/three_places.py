"""A robot that drives towards three things, on a map that has them or on none, over any pool of backends."""

from typing import Any

from semantic_slam.configuration import Configuration, from_dict
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import BackendPool
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

PLACES = ((3.0, 0.5), (3.5, -0.6), (2.0, 1.0))
CLOSED = from_dict({"semantic_model": {"kind": "none"}})
OPEN = from_dict(
    {
        "semantic_model": {"kind": "none"},
        "association": "open",
        "open_world": {"iterate_updates": False},
        "revision": {"every_keyframes": 1},
    }
)


def drive(configuration: Configuration, pool: BackendPool, num_keyframes: int = 4) -> list[Any]:
    covariance = dict(sigma_m=0.1, sigma_rad=0.1)
    prior = MapPrior(tuple(ObjectPrior.planar(n, x, y, **covariance) for n, (x, y) in enumerate(PLACES)))
    run = make_run_configuration(configuration, prior, *initial_pose_of(configuration), stamp_ns=1)
    engine = Engine.of_run(run, pool)
    beliefs = []
    for k in range(num_keyframes):
        seen = [Detection.at(x - 0.1 * (k + 1), y) for x, y in PLACES]
        beliefs.append(engine.process(Keyframe.planar(k, detections=seen, motion=(0.1, 0.0, 0.0))))
    return beliefs

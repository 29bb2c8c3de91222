"""A robot that comes back from a blind stretch with drift, and takes what it sees first for new."""

import numpy as np

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe
from semantic_slam.geometry import se2
from semantic_slam.inference.protocol import BackendPool

LANDMARKS = np.array([[2.0, 2.2], [2.5, -2.0], [6.0, 0.3]])
SIGMAS = np.array([0.05, 0.02])


def open_world(revision: dict[str, int], merging: dict[str, float] | None = None, **others: object) -> Configuration:
    """Posts without classes, three in five of them detected; ``merging``: more of section ``open_world``."""
    region = {"min_range_m": 0.3, "max_range_m": 8.0, "field_of_view_rad": 2.5, "occluder_radius_m": 0.0}
    rates = {"detection_probability": 0.6, "clutter_per_frame": 0.01, "birth_density": 0.1}
    return Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={**region, **rates, "iterate_updates": False, **(merging or {})},
        revision=revision,
        **others,
    )


def seen_from(robot: np.ndarray, numbers: list[int]) -> list[Detection]:
    points = [se2.between(robot, np.array([*LANDMARKS[n], 0.0]))[:2] for n in numbers]
    polar = [(float(np.hypot(*p)), float(np.arctan2(p[1], p[0]))) for p in points]
    return [Detection(range_m=r, bearing_rad=b, covariance=np.diag(SIGMAS**2)) for r, b in polar]


def return_with_drift(
    revision: dict[str, int], pool: BackendPool | None = None, *, pruning: dict[str, int] | None = None
) -> tuple[Engine, list[HybridBelief]]:
    """A return after a blind stretch with 1.9 m of drift; ``pool`` None: one backend in this process.

    ``pruning`` None: one hypothesis alone is followed.
    """
    covariance = np.diag([1e-6] * 3)
    engine = Engine(open_world(revision, pruning=pruning or {"max_hypotheses": 1}), initial_covariance=covariance)
    if pool is not None:
        engine = Engine.of_run(engine.run, pool)
    beliefs = [
        engine.process(Keyframe.planar(k, detections=seen_from(np.zeros(3), [0, 1, 2]), motion_sigmas=(1e-3,) * 3))
        for k in range(3)
    ]
    drift = np.array([-1.2, 1.4, 0.0])
    for k, numbers in enumerate([[0], [1], [2], [0], [1], [2]], start=3):
        motion, sigmas = (drift, (1.0, 1.0, 0.05)) if k == 3 else (np.zeros(3), (1e-3,) * 3)
        detections = seen_from(np.zeros(3), numbers)
        beliefs.append(engine.process(Keyframe.planar(k, motion=motion, detections=detections, motion_sigmas=sigmas)))
    return engine, beliefs

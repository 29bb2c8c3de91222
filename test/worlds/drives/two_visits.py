"""A corridor driven twice by one hypothesis alone, which maps it anew after a blind way back with much drift."""

import numpy as np

from semantic_slam import Configuration, Detection, Keyframe
from semantic_slam.geometry import se2

LANDMARKS = np.array([[1.0, 1.0], [2.2, -1.0], [3.9, 1.3], [5.0, -0.8], [6.9, 0.9], [8.1, -1.2], [9.2, 0.7]])
SIGMAS = np.array([0.05, 0.02])
DRIFT = np.array([1.3, 1.1, 0.05])
"""By which odometry is wrong on the way back."""
SPEED_M, VISIT, BLIND = 0.4, 24, 54
"""Metres to the next keyframe, keyframes of each visit, and of the way back."""
LENGTH = 2 * VISIT + BLIND


LABELS = ("post", "door", "door", "post", "door", "post", "post")
"""What the detector calls each landmark."""
LOOKS = dict(zip(("post", "door"), np.random.default_rng(7).normal(size=(2, 24)), strict=True))
"""What landmarks of each label look like, all alike, which views show with noise."""
LOOK_SIGMA = 0.3


def configured(every: int, kind: str = "none") -> Configuration:
    """``every``: keyframes from one look back to the next; ``kind`` of class models."""
    region = {"min_range_m": 0.2, "max_range_m": 3.0, "field_of_view_rad": 2.5, "occluder_radius_m": 0.0}
    rates = {"detection_probability": 0.9, "clutter_per_frame": 0.01, "birth_density": 0.1}
    return Configuration.of(
        association="open",
        semantic_model={"kind": kind, "labels": ("post", "door")},
        detection_errors={"correlated_share": 0.5},
        open_world={**region, **rates, "iterate_updates": False},
        pruning={"max_hypotheses": 1},
        revision={"reassociate_every_keyframes": every, "horizon": 1},
    )


def keyframes() -> list[Keyframe]:
    """The same for every robot."""
    rng, found, robot = np.random.default_rng(3), [], np.zeros(3)
    for k in range(LENGTH):
        ahead, back = np.array([SPEED_M, 0.0, 0.0]), VISIT <= k < VISIT + BLIND
        motion, sigmas, told = ahead, (0.01, 0.01, 0.004), ahead
        if k == 0:
            motion = told = np.zeros(3)
        elif k == VISIT:
            motion, sigmas = se2.between(robot, np.zeros(3)), (1.5, 1.5, 0.05)
            told = se2.compose(motion, DRIFT)
        elif back:
            motion = told = np.zeros(3)
        robot = se2.compose(robot, motion)
        noise = np.array(sigmas) * rng.standard_normal(3) if motion.any() and k != VISIT else np.zeros(3)
        seen = [] if back else _seen_from(robot, rng)
        found.append(Keyframe.planar(k, motion=told + noise, detections=seen, motion_sigmas=sigmas))
    return found


def _seen_from(robot: np.ndarray, rng: np.random.Generator) -> list[Detection]:
    points = [se2.between(robot, np.array([*own, 0.0]))[:2] for own in LANDMARKS]
    polar = [np.array([np.hypot(*p), np.arctan2(p[1], p[0])]) for p in points]
    seen = [n for n, own in enumerate(polar) if own[0] < 2.9 and abs(own[1]) < 1.2]
    noisy = [(n, *(polar[n] + SIGMAS * rng.standard_normal(2))) for n in seen]
    return [
        Detection(
            range_m=r,
            bearing_rad=b,
            covariance=np.diag(SIGMAS**2),
            label=LABELS[n],
            class_scores={LABELS[n]: 0.8},
            embedding=_look(n, r, b),
        )
        for n, r, b in noisy
    ]


def _look(landmark: int, range_m: float, bearing_rad: float) -> np.ndarray:
    """The look of a landmark; its noise is drawn for the detection's place, so places are as they were without."""
    keys = np.abs(np.array([range_m, bearing_rad]).view(np.int64)).tolist()
    look = LOOKS[LABELS[landmark]]
    return look + LOOK_SIGMA * np.random.default_rng(keys).normal(size=len(look))

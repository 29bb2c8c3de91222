"""Evidence of long windows: headings of several objects, of which no view tells one side alone, and few samples."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior, ObjectPrior

PLACES = np.array([[3.0, 1.2], [3.2, -1.5]])
ALPHA = 0.6


def log_evidence(seed: int, samples: int) -> float:
    """Of five keyframes of a robot that drives past two objects whose headings the map has to 0.4 rad."""
    random = np.random.default_rng(seed)
    headings = random.uniform(-3.0, 3.0, size=2)
    configuration = Configuration.of(
        association="given",
        semantic_model={"kind": "parametric", "alpha": ALPHA, "concentration": 6.0, "outlier_share": 0.0},
        closed_world={"clutter_per_frame": 0.0},
        visibility={"max_range_m": 50.0, "field_of_view_rad": 6.283},
        weights={"importance_samples": samples},
    )
    known = MapPrior(
        tuple(
            ObjectPrior.planar(n, *PLACES[n], headings[n], sigma_m=0.1, sigma_rad=0.4, name=f"t{n}") for n in range(2)
        )
    )
    engine = Engine(configuration, known, initial_covariance=np.diag([0.15, 0.15, 0.1]) ** 2)
    for k in range(5):
        robot = np.array([0.45 * k, 0.0])
        seen = [_seen(n, robot, headings[n] + 0.4 * random.normal(), random) for n in range(2)]
        motion = (0.45 if k else 0.0, 0.0, 0.0)
        engine.process(Keyframe.planar(k, motion=motion, motion_sigmas=(0.05, 0.05, 0.03), detections=seen))
    return engine.log_evidence


def _seen(n: int, robot: np.ndarray, heading: float, random: np.random.Generator) -> Detection:
    away = PLACES[n] - robot
    front = ALPHA * np.sin(0.5 * (np.arctan2(*-away[::-1]) - heading)) ** 2 + 1.0 - ALPHA
    scores = np.array([front, 1.0 - front]) + 0.15 * random.normal(size=2)
    return Detection(
        range_m=float(np.hypot(*away)),
        bearing_rad=float(np.arctan2(away[1], away[0])),
        covariance=np.diag([0.01, 0.0025]),
        class_scores={"class_1": float(scores[0]), "class_2": float(scores[1])},
        track_id=f"t{n}",
    )


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_a_thousand_samples_tell_the_evidence_of_many_views(seed: int) -> None:
    """In 21 dimensions and more, where a proposal that fits few samples misses the tails."""
    assert log_evidence(seed, 1024) == pytest.approx(log_evidence(seed, 16384), abs=0.1)

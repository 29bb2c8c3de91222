"""An object first seen along a ray alone is seen again: its weight beside a new one, against an integral."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.models.spatial.log_range import LogRange

RAY_SIGMA, DETECTED, BORN, CLUTTER = 0.01, 0.9, 0.3, 0.05
NEAREST_M, FARTHEST_M, HALF_WIDTH_RAD, HALF_HEIGHT_RAD = 0.3, 5.0, 0.7, 0.55
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
SHELL_M3 = (FARTHEST_M**3 - NEAREST_M**3) / 3.0
"""Volume of the region per solid angle."""
CLUTTER_DENSITY = CLUTTER / (4.0 * np.arcsin(np.sin(HALF_WIDTH_RAD) * np.sin(HALF_HEIGHT_RAD)) * SHELL_M3)


def log_odds(place: tuple[float, float], range_m: float) -> float:
    """That a detection from ``place`` is of the object seen ahead before, to that it is of another one."""
    engine = Engine(
        Configuration.of(
            state_space="spatial",
            observation="points",
            association="open",
            semantic_model={"kind": "none"},
            open_world={
                "birth_density": BORN,
                "clutter_per_frame": CLUTTER,
                "detection_probability": DETECTED,
                "min_range_m": NEAREST_M,
                "max_range_m": FARTHEST_M,
                "field_of_view_rad": 2.0 * HALF_WIDTH_RAD,
                "vertical_field_of_view_rad": 2.0 * HALF_HEIGHT_RAD,
                "occluder_radius_m": 0.05,
                "least_undetected_share": 1.0,
                "merge_position_m": 0.0,
            },
            pruning={"ratio": 1e12},
        ),
        initial_pose=ORIGIN,
        initial_covariance=1e-10 * np.eye(6),
    )
    known = 1e-12 * np.eye(6)
    engine.process(Keyframe.spatial(0, detections=[along([1.0, 0.0, 0.0])], motion_covariance=known))
    motion, seen = np.append([*place, 0.0], ORIGIN[3:]), along([range_m - place[0], -place[1], 0.0])
    belief = engine.process(Keyframe.spatial(1, motion=motion, detections=[seen], motion_covariance=known))
    (_, same), (_, other) = sorted((own.associations, own.weight) for own in belief.hypotheses)
    return float(np.log(same / other))


def along(ray: list[float]) -> Detection:
    return Detection.along(ray, ray_covariance=RAY_SIGMA**2 * np.eye(3))


def integrated(place: tuple[float, float], range_m: float) -> float:
    """Over the range, a Gaussian in its logarithm, and over the error of the first ray in the plane of motion."""
    prior = LogRange.between(NEAREST_M, FARTHEST_M)
    steps, aside = np.linspace(-6.0, 6.0, 3001), RAY_SIGMA * np.linspace(-4.0, 4.0, 41)
    weights = np.exp(-0.5 * (steps[:, None] ** 2 + (aside / RAY_SIGMA) ** 2))
    weights /= weights.sum()
    reach = np.exp(prior.mean + prior.sigma * steps)[:, None]
    ahead, left = reach * np.cos(aside) - place[0], reach * np.sin(aside) - place[1]
    distance, bearing = np.hypot(ahead, left), np.arctan2(left, ahead)
    in_view = (distance > NEAREST_M) & (distance < FARTHEST_M) & (np.abs(bearing) < HALF_WIDTH_RAD)
    off = bearing - np.arctan2(-place[1], range_m - place[0])
    vertical = RAY_SIGMA**2 * (1.0 + (reach / distance) ** 2)  # of both rays, for errors across the plane
    density = np.exp(-0.5 * (off / RAY_SIGMA) ** 2) / (2.0 * np.pi * RAY_SIGMA * np.sqrt(vertical))
    existence = BORN * DETECTED / (BORN * DETECTED + CLUTTER_DENSITY)
    same = existence * DETECTED * float((weights * in_view * density).sum())
    missed = 1.0 - existence * DETECTED * float((weights * in_view).sum())
    return float(np.log(same / (missed * (BORN * DETECTED + CLUTTER_DENSITY) * SHELL_M3)))


@pytest.mark.parametrize(
    ("place", "range_m"), [((1.0, 0.05), 4.5), ((1.5, 0.05), 2.5), ((2.5, 0.05), 4.5), ((0.0, 1.5), 2.5)]
)
def test_what_is_seen_is_in_view_wherever_along_its_ray_it_was_expected(
    place: tuple[float, float], range_m: float
) -> None:
    """With the detection probability of the prediction, much of whose ray is out of view, 1 to 4 nats too little."""
    assert log_odds(place, range_m) == pytest.approx(integrated(place, range_m), abs=0.4)

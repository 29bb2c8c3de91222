"""A robot that hardly knows where it stands in a corridor: its detections are weighed where they put it."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior, ObjectPrior

NOISE, ALONG, ACROSS, PLACED = 1e-3, 0.9, 0.05, 0.02
"""Variance [m^2] of a detection; standard deviations [m] of the robot along and across the corridor, and of the map."""
DETECTED, INTENSITY = 0.9, 0.009
"""Probability of a detection; expected first detections per square metre, and false alarms beside them too few."""
FAR_TO_SEE = {"max_range_m": 12.0, "field_of_view_rad": 3.0, "occluder_radius_m": 0.0}


def log_odds(along_m: float, **settings: object) -> float:
    """Of the object that the map has, 3 m to the side, against a new one; the object is ``along_m`` along."""
    prior = MapPrior((ObjectPrior.planar(1, 3.0, along_m, sigma_m=PLACED, sigma_rad=0.02),))
    configuration = Configuration.of(
        semantic_model={"kind": "none"},
        association="open",
        pruning={"ratio": 1e12},
        open_world={"merge_position_m": 0.0, "clutter_per_frame": 1e-6, **FAR_TO_SEE, **settings},
    )
    around = np.diag([ACROSS, ALONG, 1e-3]) ** 2
    engine = Engine(configuration, prior, initial_pose=(0, 0, 0), initial_covariance=around)
    detection = Detection.at(3.0, 0.0, covariance=NOISE * np.eye(2))
    belief = engine.process(Keyframe.planar(0, detections=[detection], motion_sigmas=(1e-3,) * 3))
    log_weights = {own.associations[0]: np.log(own.weight) for own in belief.hypotheses}
    return float(log_weights[1] - log_weights[2])


def exact(along_m: float) -> float:
    """Places and their errors are Gaussian along the axes of the corridor, if the heading is known."""
    across, along = np.array([ACROSS, ALONG]) ** 2 + PLACED**2 + NOISE
    density = np.exp(-0.5 * along_m**2 / along) / (2.0 * np.pi * np.sqrt(across * along))
    return float(np.log(DETECTED * density / INTENSITY))


@pytest.mark.parametrize("iterate_updates", [True, False])
@pytest.mark.parametrize("along_m", [0.5, 1.5, 2.1])
def test_a_known_object_is_recognised_as_far_off_as_the_robot_may_be(along_m: float, iterate_updates: bool) -> None:
    """At the prediction one linearisation has it at 10 nats too little from 1.45 m on, and beyond every gate."""
    assert log_odds(along_m, iterate_updates=iterate_updates) == pytest.approx(exact(along_m), abs=0.01)

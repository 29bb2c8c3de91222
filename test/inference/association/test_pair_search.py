"""A robot that hardly knows where it stands in a corridor: its detections are weighed where they put it."""

from typing import Any

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe, MapPrior, ObjectPrior

NOISE, ALONG, ACROSS, PLACED = 1e-3, 0.9, 0.05, 0.02
"""Variance [m^2] of a detection; standard deviations [m] of the robot along and across the corridor, and of the map."""
DETECTED, INTENSITY = 0.9, 0.009
"""Probability of a detection; expected first detections per square metre, and false alarms beside them too few."""
BORN = 0.001
"""Objects per cubic metre."""
FAR_TO_SEE = {"max_range_m": 12.0, "field_of_view_rad": 3.0, "occluder_radius_m": 0.0}


def log_odds(along_m: float, **settings: object) -> float:
    """Of the object that the map has, 3 m to the side, against a new one; the object is ``along_m`` along."""
    prior = MapPrior((ObjectPrior.planar(1, 3.0, along_m, sigma_m=PLACED, sigma_rad=0.02),))
    configuration = open_world(settings)
    around = np.diag([ACROSS, ALONG, 1e-3]) ** 2
    engine = Engine(configuration, prior, initial_pose=(0, 0, 0), initial_covariance=around)
    detection = Detection.at(3.0, 0.0, covariance=NOISE * np.eye(2))
    return odds_in(engine.process(Keyframe.planar(0, detections=[detection], motion_sigmas=(1e-3,) * 3)))


def log_odds_in_space(along_m: float) -> float:
    """In space, with a robot that is as uncertain in height as across the corridor."""
    prior = MapPrior((ObjectPrior.point(1, (3.0, along_m, 0.0), sigma_m=PLACED),))
    region = {"vertical_field_of_view_rad": 2.5, "occluder_radius_m": 0.001, "least_undetected_share": 1.0}
    configuration = open_world({**region, "birth_density": BORN}, state_space="spatial", observation="points")
    around = np.diag([ACROSS, ALONG, ACROSS, 1e-3, 1e-3, 1e-3]) ** 2
    engine = Engine(configuration, prior, initial_pose=(0, 0, 0, 0, 0, 0, 1), initial_covariance=around)
    detection = Detection.in_space((3.0, 0.0, 0.0), covariance=NOISE * np.eye(3))
    keyframe = Keyframe.spatial(0, detections=[detection], motion_covariance=1e-12 * np.eye(6))
    return odds_in(engine.process(keyframe))


def open_world(settings: dict[str, Any], **others: Any) -> Configuration:
    return Configuration.of(
        semantic_model={"kind": "none"},
        association="open",
        pruning={"ratio": 1e12},
        open_world={"merge_position_m": 0.0, "clutter_per_frame": 1e-6, **FAR_TO_SEE, **settings},
        **others,
    )


def odds_in(belief: HybridBelief) -> float:
    log_weights = {own.associations[0]: np.log(own.weight) for own in belief.hypotheses}
    return float(log_weights[1] - log_weights[2])


def exact(along_m: float) -> float:
    """Places and their errors are Gaussian along the axes of the corridor, if the heading is known."""
    return float(np.log(DETECTED * density(along_m, ACROSS) / INTENSITY))


def density(along_m: float, *aside: float) -> float:
    """Of the place where the object is seen, with a robot known to ``aside`` [m] along each of the other axes."""
    along, *others = np.array([ALONG, *aside]) ** 2 + PLACED**2 + NOISE
    volume = np.sqrt(2.0 * np.pi * along) * np.prod(np.sqrt(2.0 * np.pi * np.array(others)))
    return float(np.exp(-0.5 * along_m**2 / along) / volume)


@pytest.mark.parametrize("iterate_updates", [True, False])
@pytest.mark.parametrize("along_m", [0.5, 1.5, 2.1])
def test_a_known_object_is_recognised_as_far_off_as_the_robot_may_be(along_m: float, iterate_updates: bool) -> None:
    """At the prediction one linearisation has it at 10 nats too little from 1.45 m on, and beyond every gate."""
    assert log_odds(along_m, iterate_updates=iterate_updates) == pytest.approx(exact(along_m), abs=0.01)


@pytest.mark.parametrize("along_m", [0.5, 1.5, 2.1])
def test_a_known_object_in_space_is_recognised_as_far_off_as_the_robot_may_be(along_m: float) -> None:
    """At the prediction no gate admits it from 1.5 m on: a new object had all the weight, exactly 2e-5."""
    intensity = BORN * DETECTED * (1.0 - DETECTED)  # and the object missed
    expected = np.log(DETECTED * density(along_m, ACROSS, ACROSS) / intensity)
    assert log_odds_in_space(along_m) == pytest.approx(float(expected), abs=0.02)

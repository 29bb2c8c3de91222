"""The robots that tour: shipped configurations, each given keyframes ready made."""

from dataclasses import replace
from typing import Any

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.soak.tour import Tour

ROBOTS = {
    "given": "victoria_park",
    "open": "open_world",
    "uncalibrated": "uncalibrated",
    "map": "known_map",
    "session": "second_session",
}
"""Name -> shipped configuration: identities given; no map; no map and nobody calibrated it; on a map, of which all is
still there, or some may have left; there it may be carried."""
ON_A_MAP = ("map", "session")

WHEELS: dict[str, Any] = {"sigma_translation_per_m": 0.02, "sigma_rotation_per_m": 0.01, "sigma_rotation_per_rad": 0.02}
"""Odometry of the robot without a map: things that look alike do not place it where it is worse for a whole round."""


def robot(name: str, horizon_keyframes: int = 0) -> Configuration:
    """The configuration of a robot without class models; what the building does to a detector is that of its tour."""
    base = load_configuration(configuration_file(ROBOTS[name]))
    if name == "open":
        base = replace(base, odometry=replace(base.odometry, **WHEELS))
    if name == "session":  # it knows where it starts
        base = replace(base, revision=replace(base.revision, lost_every_keyframes=0))
    return replace(
        base,
        semantic_model=replace(base.semantic_model, kind="none"),
        keyframes=replace(base.keyframes, policy="every_detection"),
        history=replace(base.history, horizon_keyframes=horizon_keyframes),
        initial_pose=replace(base.initial_pose, mean=(0.0, 0.0, 0.0), sigma=(0.01, 0.01, 0.01)),
    )


def map_of(name: str) -> MapPrior | None:
    """The map of a robot that has one: all things along its tour, each to a decimetre."""
    if name not in ON_A_MAP:
        return None
    things = enumerate(Tour.things().tolist())
    return MapPrior(tuple(ObjectPrior.planar(n, x, y, sigma_m=0.1, sigma_rad=1.0) for n, (x, y) in things))

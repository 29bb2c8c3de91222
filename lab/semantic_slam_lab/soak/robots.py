"""The robots that tour: shipped configurations, each given keyframes ready made."""

from dataclasses import replace
from typing import Any

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.shipped import configuration_file

ROBOTS = {"given": "victoria_park", "open": "open_world", "uncalibrated": "uncalibrated"}
"""Name -> shipped configuration: identities given; no map; no map and nobody calibrated it."""

WHEELS: dict[str, Any] = {"sigma_translation_per_m": 0.02, "sigma_rotation_per_m": 0.01, "sigma_rotation_per_rad": 0.02}
"""Odometry of the robot without a map: things that look alike do not place it where it is worse for a whole round."""


def robot(name: str, horizon_keyframes: int = 0) -> Configuration:
    """The configuration of a robot without class models; what the building does to a detector is that of its tour."""
    base = load_configuration(configuration_file(ROBOTS[name]))
    if name == "open":
        base = replace(base, odometry=replace(base.odometry, **WHEELS))
    return replace(
        base,
        semantic_model=replace(base.semantic_model, kind="none"),
        keyframes=replace(base.keyframes, policy="every_detection"),
        history=replace(base.history, horizon_keyframes=horizon_keyframes),
        initial_pose=replace(base.initial_pose, mean=(0.0, 0.0, 0.0), sigma=(0.01, 0.01, 0.01)),
    )

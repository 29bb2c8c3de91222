"""Priors of an object that a detection creates, and how well gravity holds any."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class NewObjectConfiguration:
    sigma_position_m: float = parameter(
        1000.0, "prior of an object created from a detection, about its first estimate", minimum=1e-3
    )
    sigma_heading_rad: float = parameter(
        3.1, "broad heading prior of an object whose model fixes no heading", minimum=1e-3
    )
    sigma_tilt_rad: float = parameter(
        0.02,
        "roll and pitch by which an object in space stands off upright, and off what its map says; gravity holds them",
        minimum=1e-6,
    )
    range_m: float = parameter(3.0, "assumed range of an object first seen without depth", minimum=1e-3)

"""Priors of an object that a detection creates."""

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
    range_m: float = parameter(3.0, "assumed range of an object first seen without depth", minimum=1e-3)

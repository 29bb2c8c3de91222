"""Where an object of a known map is observed."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class VisibilityConfiguration:
    max_range_m: float = parameter(
        0.0, "P(beta | x, O): range in which an object is observed; 0: everywhere", minimum=0.0
    )
    field_of_view_rad: float = parameter(0.0, "full angle in which an object is observed; 0: all around", minimum=0.0)
    softness: float = parameter(0.1, "relative width of the soft edge used by the Laplace method", minimum=1e-6)

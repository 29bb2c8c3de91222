"""Quantities to calibrate that hypotheses do not estimate, searched in steps by factors of two."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from semantic_slam.configuration import Configuration, from_dict, to_dict

ODOMETRY = (
    "sigma_translation_per_m",
    "sigma_rotation_per_m",
    "sigma_rotation_per_rad",
    "sigma_translation_floor_m",
    "sigma_rotation_floor_rad",
)
DETECTIONS = ("sigma_range_m", "sigma_range_per_m", "sigma_bearing_rad")
CLUTTER = {
    "open": "open_world.clutter_per_frame",
    "enumerated": "closed_world.clutter_per_frame",
    "given": "closed_world.wrong_identity_share",
}
"""Association strategy -> its parameters for clutter detections."""
DIGITS = 4


@dataclass(frozen=True)
class Quantity:
    """Parameters changed together: each is multiplied by 2 to the power of the number of steps."""

    name: str
    parameters: tuple[str, ...]  # dotted configuration names
    power: int = 1  # exponent of the factor; 2 for factors on variances
    of_the_rest: bool = False  # multiply 1 - value instead of the value

    def stepped(self, configuration: Configuration, steps: int) -> dict[str, Any]:
        """Parameter values ``steps`` steps from ``configuration``; parameters that are zero are left out."""
        factor = 2.0 ** (steps * self.power)
        found = {name: value_of(configuration, name) for name in self.parameters}
        return {name: self._times(value, factor) for name, value in found.items() if value}

    def _times(self, value: Any, factor: float) -> Any:
        if isinstance(value, tuple):
            return [self._times(item, factor) for item in value]
        return rounded(max(0.0, 1.0 - factor * (1.0 - value)) if self.of_the_rest else factor * value)


def quantities(configuration: Configuration, *, places_are_told: bool) -> tuple[Quantity, ...]:
    """Quantities to search, in order; ``places_are_told``: detections carry position covariances of their own."""
    found = [Quantity("noise of odometry", tuple(f"odometry.{name}" for name in ODOMETRY))]
    if places_are_told:
        found.append(Quantity("noise of detections", ("perception.noise_factors",), power=2))
    else:
        found.append(Quantity("noise of detections", tuple(f"perception.{name}" for name in DETECTIONS)))
    if configuration.detection_errors.correlated_share > 0.0 and not configuration.detection_errors.correlated_shares:
        found.append(Quantity("what does not repeat", ("detection_errors.correlated_share",), of_the_rest=True))
    if configuration.association in CLUTTER and not configuration.open_world.clutters_per_frame:
        found.append(Quantity("clutter", (CLUTTER[configuration.association],)))
    return tuple(item for item in found if item.stepped(configuration, 1))


def value_of(configuration: Configuration, name: str) -> Any:
    """The value of a parameter by its dotted name."""
    value: Any = configuration
    for part in name.split("."):
        value = getattr(value, part)
    return value


def with_values(configuration: Configuration, changes: Mapping[str, Any]) -> Configuration:
    """Configuration with values changed by dotted name. Raises InputError for one beyond its limits."""
    values = to_dict(configuration)
    for name, value in changes.items():
        *sections, last = name.split(".")
        place = values
        for section in sections:
            place = place[section]
        place[last] = value
    return from_dict(values, "calibration")


def rounded(value: float) -> float:
    """Round to the digits written to the file, so that the evaluated value is the written one."""
    return float(f"{value:.{DIGITS}g}")

"""The noise and sensor parameters that a run infers, as the belief reports them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models import odometry_bias
from semantic_slam.inference.models.noise.noise_settings import NAMES, NoiseSettings
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states import detection_rates
from semantic_slam.inference.states.detection_rates import DetectionRates

SENSOR_NAMES = ("detection_errors.range_offset_m", "detection_errors.yaw_rad")
"""Constant biases of the sensor (range offset, mounting yaw), in the order of g (see ``correlated_errors``)."""


@dataclass(frozen=True, kw_only=True)
class InferredNoise:
    """N inferred parameters: noise settings by hypothesis, wheel slip, detection rates, odometry and sensor biases."""

    settings: tuple[str, ...] = ()  # noise settings in which hypotheses differ, as the configuration names them
    slips: tuple[str, ...] = ()  # whether the newest motion slipped, where slip is modelled
    rates: tuple[str, ...] = ()  # detection, clutter and birth rates; each hypothesis is a mixture over them
    bias_means: Array = field(default_factory=lambda: np.zeros(0))  # (p,) prior means of the odometry biases
    bias_sigmas: Array = field(default_factory=lambda: np.zeros(0))  # (p,) prior sigmas; 0: that bias is not estimated
    sensor_sigmas: Array = field(default_factory=lambda: np.zeros(2))  # prior sigmas of sensor biases; 0: not estimated

    @classmethod
    def of(
        cls, configuration: Configuration, noise_settings: Sequence[NoiseSettings | None], rates: DetectionRates
    ) -> Self:
        """The parameters that the configuration leaves open, given the noise settings and rates of hypotheses."""
        odometry, errors = configuration.odometry, configuration.detection_errors
        differing = [
            name for name, own in NAMES.items() if len({getattr(one, own, None) for one in noise_settings}) > 1
        ]
        open_rates = [name for name, own in detection_rates.NAMES.items() if len(np.unique(getattr(rates, own))) > 1]
        means, sigmas = odometry_bias.bias_means(odometry), odometry_bias.bias_sigmas(odometry)
        return cls(
            settings=tuple(differing),
            slips=("odometry.slipped",) if odometry.slip_share > 0.0 else (),
            rates=tuple(open_rates),
            bias_means=means,
            bias_sigmas=sigmas,
            sensor_sigmas=np.array([errors.sigma_range_offset_m, errors.sigma_yaw_rad]),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """(N,) names of the parameters, as in the configuration."""
        estimated = [name for name, sigma in zip(odometry_bias.NAMES, self.bias_sigmas, strict=False) if sigma > 0.0]
        estimated += [name for name, sigma in zip(SENSOR_NAMES, self.sensor_sigmas, strict=True) if sigma > 0.0]
        return (*self.settings, *self.slips, *self.rates, *estimated)

    def moments(self, component: Component) -> Array:
        """(N, 2) means and standard deviations of the parameters under one hypothesis."""
        settings = [(getattr(component.noise_settings, NAMES[name]), 0.0) for name in self.settings]
        settings += [(float(component.slipped), 0.0) for _ in self.slips]
        rates = component.objects.rates
        settings += [rates.moments(detection_rates.NAMES[name]) for name in self.rates]
        biases = np.zeros((len(self.bias_sigmas), 2))
        if len(biases) and component.tracked is not None:
            tracked = component.tracked
            biases = self.bias_sigmas[:, None] * np.stack([tracked.bias, tracked.bias_sigmas], axis=1)
            biases[:, 0] += self.bias_means
        sensor = self._sensor(component)
        parts = np.reshape(settings, (-1, 2)), biases[self.bias_sigmas > 0.0], sensor[self.sensor_sigmas > 0.0]
        return np.concatenate(parts)

    def _sensor(self, component: Component) -> Array:
        """(2, 2) means and standard deviations of the sensor's biases; the prior while detections tell nothing."""
        known = None if component.tracked is None else component.tracked.sensor
        moments = np.array([[0.0, 1.0]] * 2) if known is None else known
        return self.sensor_sigmas[:, None] * moments

    def marginals(self, weights: Array, moments: Array, sensed: SensedRegion | None) -> dict[str, Any]:
        """The belief's fields ``noise_*`` from (H,) weights and (H, N, 2) moments, and the learned sensor region.

        The region's standard deviations are NaN, since it is a bound over the detections so far; so is that of a half
        range that may be infinite.
        """
        means, sigmas = moments[..., 0], moments[..., 1]
        mean = weights @ means
        off = np.subtract(means, mean, out=np.full(means.shape, np.nan), where=np.isfinite(mean))
        variance = weights @ (sigmas**2 + off**2)
        region = {} if sensed is None else sensed.named()
        return {
            "noise_names": (*self.names, *region),
            "noise_values": np.concatenate([mean, list(region.values())]),
            "noise_sigmas": np.concatenate([np.sqrt(variance), np.full(len(region), np.nan)]),
        }

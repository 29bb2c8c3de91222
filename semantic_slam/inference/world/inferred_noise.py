"""What a run infers of the noise of its robot and its sensor, as the belief states it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models import odometry_bias
from semantic_slam.inference.models.noise_settings import NAMES, NoiseSettings
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states import detection_rates
from semantic_slam.inference.states.detection_rates import DetectionRates


@dataclass(frozen=True, kw_only=True)
class InferredNoise:
    """N quantities: those that hypotheses differ in, and biases of odometry that are estimated with the poses."""

    settings: tuple[str, ...] = ()  # as the configuration names them
    rates: tuple[str, ...] = ()  # of what is detected and is there; each hypothesis is a mixture over them
    bias_means: Array = field(default_factory=lambda: np.zeros(0))  # (p,) of the prior
    bias_sigmas: Array = field(default_factory=lambda: np.zeros(0))  # (p,) 0: that one is not estimated

    @classmethod
    def of(cls, odometry: OdometryConfiguration, noises: Sequence[NoiseSettings | None], rates: DetectionRates) -> Self:
        """What is left open by the configuration of odometry, and by noises and rates that a robot may have."""
        differing = [name for name, own in NAMES.items() if len({getattr(one, own, None) for one in noises}) > 1]
        open_rates = [name for name, own in detection_rates.NAMES.items() if len(np.unique(getattr(rates, own))) > 1]
        means, sigmas = odometry_bias.bias_means(odometry), odometry_bias.bias_sigmas(odometry)
        return cls(settings=tuple(differing), rates=tuple(open_rates), bias_means=means, bias_sigmas=sigmas)

    @property
    def names(self) -> tuple[str, ...]:
        """(N,) as the configuration has them."""
        estimated = [name for name, sigma in zip(odometry_bias.NAMES, self.bias_sigmas, strict=False) if sigma > 0.0]
        return (*self.settings, *self.rates, *estimated)

    def moments(self, component: Component) -> Array:
        """(N, 2) means and standard deviations under one hypothesis."""
        settings = [(getattr(component.settings, NAMES[name]), 0.0) for name in self.settings]
        rates = component.objects.rates
        settings += [rates.moments(detection_rates.NAMES[name]) for name in self.rates]
        biases = np.zeros((len(self.bias_sigmas), 2))
        if len(biases) and component.tracked is not None:
            tracked = component.tracked
            biases = self.bias_sigmas[:, None] * np.stack([tracked.bias, tracked.bias_sigmas], axis=1)
            biases[:, 0] += self.bias_means
        return np.concatenate([np.reshape(settings, (-1, 2)), biases[self.bias_sigmas > 0.0]])

    def marginals(self, weights: Array, moments: Array, sensed: SensedRegion | None) -> dict[str, Any]:
        """What a belief says of them, from (H,) weights and (H, N, 2) moments; and the region that was learned.

        A region that detections bound has no standard deviation: NaN.
        """
        means, sigmas = moments[..., 0], moments[..., 1]
        mean = weights @ means
        variance = weights @ (sigmas**2 + (means - mean) ** 2)
        region = {} if sensed is None else sensed.named()
        return {
            "noise_names": (*self.names, *region),
            "noise_values": np.concatenate([mean, list(region.values())]),
            "noise_sigmas": np.concatenate([np.sqrt(variance), np.full(len(region), np.nan)]),
        }

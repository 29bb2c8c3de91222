"""Directional dependence of the detection probability, learned from the looks of runs.

Each of a few evenly spaced directions across the field of view has a share of the detection probability, linearly
interpolated between them. The shares are maximised one direction at a time, under the best of the other settings, and
these again under the shares (coordinate ascent). A smoothness prior couples neighbours, so that a direction without
looks takes the values beside it.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.training.detection.evidence import RunLooks
from semantic_slam.training.detection.looks import NUM_DIRECTIONS

LEVELS = np.array([0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
"""Shares tried, relative to the best direction."""
NEIGHBOUR_SIGMA = 0.5
"""Prior standard deviation of the difference of neighbouring log shares."""
ROUNDS, MOST_SWEEPS = 2, 4


@dataclass(frozen=True, kw_only=True)
class Directions:
    """Maximum-likelihood estimation of direction shares together with the settings ``tried``."""

    looks: RunLooks
    tried: DetectionRates  # G
    alike: Array  # (B, F, G) log evidence with all directions equal

    def likeliest(self, counted: Flags) -> Array:
        """(NUM_DIRECTIONS,) most likely shares, from the stretches ``counted`` (B, F); 1 in the best direction."""
        shares, evidence = np.ones(NUM_DIRECTIONS), self.alike
        for _ in range(ROUNDS):
            best = int(np.argmax(evidence[counted].sum(axis=0)))
            shares = self._climbed(self.tried.take(np.array([best])), shares, counted)
            evidence = self.log_evidence(shares)
        return shares

    def log_evidence(self, shares: Array) -> Array:
        """(B, F, G) log evidence of each stretch."""
        return self.looks.log_evidence(self.tried, shares[:, None])

    def _climbed(self, rates: DetectionRates, shares: Array, counted: Flags) -> Array:
        for _ in range(MOST_SWEEPS):
            before = shares
            for number in range(NUM_DIRECTIONS):
                shares = self._improved(rates, shares, number, counted)
            if np.array_equal(shares, before):
                break
        return np.asarray(shares / shares.max())

    def _improved(self, rates: DetectionRates, shares: Array, number: int, counted: Flags) -> Array:
        """Shares with the most likely value in one of the directions."""
        variants = np.repeat(shares[:, None], len(LEVELS), axis=1)
        variants[number] = LEVELS
        logs = self.looks.log_evidence(rates, variants)[counted].sum(axis=0)
        logs -= 0.5 * np.square(np.diff(np.log(variants), axis=0) / NEIGHBOUR_SIGMA).sum(axis=0)
        return np.asarray(variants[:, int(np.argmax(logs))])

"""Corrections of a state's Gaussian by weighted samples, in units of that Gaussian's standard deviations."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.state_space import StateSpace

LEAST_SHARE = 1e-3
"""Semantic views reduce a variance to no less than this fraction of the geometric one."""


@dataclass(frozen=True)
class Correction:
    """How semantic views move and narrow a state's Gaussian, in units of its own standard deviations."""

    shift: Array  # (d,)
    covariance: Array  # (d, d), I where nothing changes

    @classmethod
    def of_samples(cls, deviations: Array, weights: Array) -> "Correction":
        """From (P, d) deviations of samples, P > d, and their (P,) normalised weights.

        Weighted moments are taken relative to the unweighted ones of the same samples, so that sampling noise cancels.
        """
        centred = deviations - deviations.mean(axis=0)
        root = np.linalg.cholesky(centred.T @ centred / len(centred))
        whitened = np.linalg.solve(root, centred.T).T
        shift = weights @ whitened
        spread = whitened - shift
        values, vectors = np.linalg.eigh((spread * weights[:, None]).T @ spread)
        return cls(shift, (vectors * np.maximum(values, LEAST_SHARE)) @ vectors.T)

    @classmethod
    def towards(
        cls, space: StateSpace, states: Array, covariances: Array, samples: Array, weights: Array
    ) -> list["Correction"]:
        """From K Gaussians at ``states`` (K, s) to the moments of (N, K, s) samples with (N,) normalised weights."""
        roots = np.linalg.cholesky(covariances)
        mean = space.mean(samples, weights)
        shifts = np.linalg.solve(roots, space.local(states, mean)[..., None])[..., 0]
        spread = np.linalg.solve(roots, np.moveaxis(space.local(mean[None], samples), 0, -1))  # (K, d, N)
        moments = (spread * weights) @ np.swapaxes(spread, 1, 2)
        return [cls(shift, covariance) for shift, covariance in zip(shifts, moments, strict=True)]

    def applied(self, space: StateSpace, state: Array, covariance: Array) -> tuple[Array, Array]:
        """A state (s,) and its covariance (d, d), corrected."""
        root = np.linalg.cholesky(covariance)
        return space.retract(state, root @ self.shift), root @ self.covariance @ root.T

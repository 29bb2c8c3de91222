"""Recursive classifier of the thesis (Alg. 3.1) in covariance form: valid for singular Sigma_z, O(k^2) per view."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.classifier import View
from semantic_slam.classification.growing import GrowingArray
from semantic_slam.classification.growing_gaussian import GrowingGaussian, NextBlock, floored_cholesky
from semantic_slam.classification.track import NextView
from semantic_slam.classification.windowed import WindowedClassifier
from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class ScorePrediction:
    """Gaussian of the scores at the next view given the class and the measurements before (Eq. 3.29)."""

    mean: Array  # (P, C, F)
    covariance: Array  # (P, C, F, F)
    floor: float  # least variance

    def log_likelihoods(self, samples: Array) -> Array:
        """(P, n, C) log density of (n, F) samples, in nats."""
        root = floored_cholesky(self.covariance, self.floor)
        residual = samples.T - self.mean[..., None]  # (P, C, F, n)
        squared = np.square(np.linalg.inv(root) @ residual).sum(axis=-2)
        logdet = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)[..., None]
        return np.asarray(-0.5 * squared - logdet - 0.5 * samples.shape[1] * np.log(2.0 * np.pi)).swapaxes(-1, -2)


class RecursiveClassifier(WindowedClassifier):
    """Updates P(c | H_k-1) to P(c | H_k) with the newest view's samples; earlier views enter by mu_z and Sigma_z.

    With a ``window`` of W views, correlations with older scores are neglected; their evidence for the class stays in
    the recursion.
    """

    def _begin(self) -> None:
        self._noise = GrowingArray((), (self._processes.num_components,) * 2)  # Sigma_z of the views before
        self._scores = GrowingGaussian(self._views.batch, self._processes.least_variance)

    def update(self, view: View) -> Array:
        next_view = self._views.next(view.locations_m)
        block = self._block(next_view)
        average = self._weigh(self._prediction(next_view, block).log_likelihoods(view.scores.samples))
        self._scores.append(block, (view.scores.mean - next_view.mean)[..., None])
        self._views.append(next_view)
        noise = view.scores.covariance
        self._noise.append(noise if self._coupling == "full" else np.diag(np.diag(noise)))
        self._keep_window()
        return average

    def predict(self, locations_m: Array) -> ScorePrediction:
        """Prediction of the scores at (P, 2) next locations, before they are measured."""
        next_view = self._views.next(locations_m)
        return self._prediction(next_view, self._block(next_view))

    def _block(self, view: NextView) -> NextBlock:
        return self._scores.predict(view.covariances[..., None], view.variance[..., None, None])

    def _prediction(self, view: NextView, block: NextBlock) -> ScorePrediction:
        """Marginal of N(mu_J, Sigma_J): mu_k + Omega (mu_z - mu), and Sigma_k|0:k-1 + Omega Sigma_z Omega^T."""
        omega = block.gain[..., 0]  # (P, C, F, k)
        size = omega.shape[2]
        covariance = np.einsum("pcfi,pcgi,ifg->pcfg", omega, omega, self._noise.values, optimize=True)
        covariance[..., range(size), range(size)] += np.square(block.root[..., 0, 0])
        return ScorePrediction(view.mean + block.shift[..., 0], covariance, self._processes.least_variance)

    def _drop_first(self) -> None:
        self._scores.drop_first()
        self._noise.drop_first()

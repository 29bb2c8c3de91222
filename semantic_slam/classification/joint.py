"""Joint classifier (coherent noisy process): log N(mu_z; mu_s, Sigma_s + Sigma_z) over all views, order-independent."""

import numpy as np

from semantic_slam.classification.classifier import View
from semantic_slam.classification.growing_gaussian import GrowingGaussian, NextBlock
from semantic_slam.classification.track import NextView
from semantic_slam.classification.windowed import WindowedClassifier
from semantic_slam.geometry.arrays import Array


class JointClassifier(WindowedClassifier):
    """Joint likelihood by the chain rule p(z_k | z_0:k-1, c), from one growing factor for every prefix of the track.

    With a ``window`` of W views each view is predicted from the W before it.
    """

    def _begin(self) -> None:
        batch = self._views.batch[:2] if self._coupling == "full" else self._views.batch
        self._scores = GrowingGaussian(batch, self._processes.least_variance)

    def update(self, view: View) -> Array:
        next_view = self._views.next(view.locations_m)
        residual = view.scores.mean - next_view.mean
        if self._coupling == "full":
            block = self._coupled(next_view, view.scores.covariance)
            log_likelihoods = self._scores.append(block, residual)
        else:
            variance = next_view.variance + np.diag(view.scores.covariance)
            block = self._scores.predict(next_view.covariances[..., None], variance[..., None, None])
            log_likelihoods = self._scores.append(block, residual[..., None]).sum(axis=-1)
        self._views.append(next_view)
        self._keep_window()
        return self._weigh(log_likelihoods[:, None, :])

    def _coupled(self, view: NextView, noise: Array) -> NextBlock:
        """Predict the F components of a view as one block: independent in the process, but coupled by Sigma_z."""
        tracks, classes, size, count = view.covariances.shape
        diagonal = np.arange(size)
        cross = np.zeros((tracks, classes, count, size, size))
        cross[..., diagonal, diagonal] = view.covariances.swapaxes(-1, -2)
        corner = np.tile(noise, (tracks, classes, 1, 1))
        corner[..., diagonal, diagonal] += view.variance
        return self._scores.predict(cross.reshape(tracks, classes, count * size, size), corner)

    def _drop_first(self) -> None:
        for _ in range(self._processes.num_components if self._coupling == "full" else 1):
            self._scores.drop_first()

"""Fitting of the appearance of known objects, with novelty scores calibrated on held-out images."""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.viewpoint.appearance import KnownAppearance, hellinger, unit

SHRINKAGE = 0.1
"""Shrinkage of covariances towards their mean variance: there are few images for the number of features."""
LEFT_OUT = 5
"""One in this many viewing directions is held out of the fit, to calibrate the novelty of known objects."""
LEAST_VIEWS = 2 * LEFT_OUT
"""Smallest number of viewing directions for a novelty model."""
MOST_SCORES = 2000
"""Scores of pictures left out that are kept; of more, evenly spaced quantiles."""
MOST_PICTURES = 2000
"""Pictures of known objects that are kept; of more, evenly spaced ones."""


def fit_appearance(
    features: Array, classes: Index, views: Index, others: Array, probe: Array
) -> KnownAppearance | None:
    """What (N, K) features of pictures of known objects look like; None with too few directions of view.

    ``classes`` (N,) are theirs, ``views`` (N,) number the directions that they were seen from: a picture is left out
    together with all others from its direction. ``others`` (M, K) are features of pictures of other things, ``probe``
    (K,) the network's features of the probe picture. What is left out stays so: then the rate of false alarms is that
    of new pictures (split conformal prediction).
    """
    tested = views % LEFT_OUT == 0
    if len(np.unique(views)) < LEAST_VIEWS or not set(classes[tested]) <= set(classes[~tested]):
        return None
    fitted = _fitted(features[~tested], classes[~tested], others, probe)
    scores = np.sort(fitted.novelty(features[tested]))
    if len(scores) > MOST_SCORES:
        scores = np.quantile(scores, np.linspace(0.0, 1.0, MOST_SCORES))
    return replace(fitted, known_scores=scores)


def _fitted(features: Array, classes: Index, others: Array, probe: Array) -> KnownAppearance:
    roots = hellinger(features)
    centre = roots.mean(axis=0)
    scale = np.sqrt(roots.var(axis=0) + roots.var())  # features that few pictures excite would tell too much else
    values = (roots - centre) / scale
    names, index = np.unique(classes, return_inverse=True)
    means = np.array([values[index == number].mean(axis=0) for number in range(len(names))])
    coordinates = np.linalg.inv(np.linalg.cholesky(_shrunk(values - means[index]))).T
    kept = np.unique(np.linspace(0, len(values) - 1, MOST_PICTURES).round().astype(int))
    return KnownAppearance(
        centre=centre,
        scale=scale,
        coordinates=coordinates,
        known=unit(values[kept] @ coordinates).astype(np.float32),
        others=unit((hellinger(others) - centre) / scale @ coordinates).astype(np.float32),
        known_scores=np.zeros(1),
        probe=probe,
    )


def _shrunk(residuals: Array) -> Array:
    """(K, K) covariance of (N, K) residuals, its eigenvalues drawn towards their mean."""
    covariance = residuals.T @ residuals / len(residuals)
    mean_variance = np.trace(covariance) / len(covariance)
    return np.asarray((1.0 - SHRINKAGE) * covariance + SHRINKAGE * mean_variance * np.eye(len(covariance)))

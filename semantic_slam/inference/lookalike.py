"""Retrieval of the mapped object that an image crop shows, from an unknown viewpoint; it may show none of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.semantics.descriptors.heading_update import DirectionalView, updated_mixtures
from semantic_slam.inference.states.heading_mixture import HeadingMixture
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel

ELEVATION_RAD = 0.25
"""Default elevation of the camera above the object, when it is unknown: that of a robot 2 m away."""


@dataclass(frozen=True, kw_only=True)
class Lookalikes:
    """Result of a query over the O objects of a belief, in its order."""

    probabilities: Array  # (O,) that the crop shows this object; they sum to 1 - unknown
    unknown: float  # probability that it shows none of them
    azimuth_rad: Array  # (O,) likeliest viewing direction if it shows this object, in the object's frame
    log_likelihood: Array  # (O,) of the crop's feature, marginalised over viewing directions

    def ranking(self) -> NDArray[np.int_]:
        """Rows in descending order of probability."""
        return np.argsort(-self.probabilities, kind="stable")


def lookalikes(
    model: DescriptorModel,
    feature: Array,
    descriptors: Array,
    variances: Array,
    existence: Array,
    elevation_rad: float = ELEVATION_RAD,
) -> Lookalikes:
    """P(object | crop) from its (F,) feature, and the belief's (O, L) descriptors, variances and (O,) existence.

    The prior is uniform over viewing directions, proportional to existence over objects, and for an unmapped object
    that of one that surely exists.
    """
    observation = LatentObservation(model)
    size = len(feature)
    view = PlanarDetection(
        range_m=1.0,
        bearing_rad=0.0,
        covariance=np.eye(2),
        sensor=np.zeros(2),
        feature=np.asarray(feature),
        feature_covariance=np.zeros((size, size)),
        elevation_rad=elevation_rad,
    )
    beliefs = [DescriptorBelief(m[None], np.sqrt(v)[None]) for m, v in zip(descriptors, variances, strict=True)]
    sightings = [
        DirectionalView(modes=HeadingMixture.all_around(each), view=0, bearing_rad=0.0, sigma_rad=0.0)
        for each in (*beliefs, model.prior)
    ]
    updated = updated_mixtures(observation, DetectionFeatures.of([view]), sightings)
    log_likelihood = np.array([evidence for _, evidence in updated])
    with np.errstate(divide="ignore"):
        joint = log_likelihood + np.log(np.append(np.clip(existence, 0.0, 1.0), 1.0))
    probabilities = np.exp(joint - np.logaddexp.reduce(joint))
    azimuth = np.array([-modes.best()[0][-1] for modes, _ in updated])
    azimuth = np.arctan2(np.sin(azimuth), np.cos(azimuth))
    return Lookalikes(
        probabilities=probabilities[:-1],
        unknown=float(probabilities[-1]),
        azimuth_rad=azimuth[:-1],
        log_likelihood=log_likelihood[:-1],
    )

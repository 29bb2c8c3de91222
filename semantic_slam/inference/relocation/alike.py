"""Class similarity of detections and objects, averaged over viewpoints; for proposals only."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.object_views import class_posterior
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints, log_density

AZIMUTHS = 36
"""Number of viewpoint directions, evenly spaced, over which class models are averaged."""
MOST_NATS = 4.0
"""Largest log ratio that one view may contribute."""


def log_alike(
    model: ViewpointModel | None,
    component: Component,
    ids: Sequence[int],
    log_class_prior: Array,
    seen: Sequence[PlanarDetection],
) -> Array:
    """(N, M) log ratios [nats]: N detections as views of M objects of a component, relative to any object.

    ``log_class_prior`` (M, C). All 0 without viewpoint models of classes.
    """
    if model is None or not seen or not len(ids):
        return np.zeros((len(seen), len(ids)))
    told = np.array([_class_probabilities(component, n, row) for n, row in zip(ids, log_class_prior, strict=True)])
    looks = np.exp(np.array([_by_class(model, own) for own in seen]))  # (N, C)
    with np.errstate(divide="ignore"):
        ratios = np.log(looks @ told.T) - np.log(looks.mean(axis=1, keepdims=True))
    return np.asarray(np.clip(ratios, -MOST_NATS, MOST_NATS))


def _class_probabilities(component: Component, object_id: int, log_prior: Array) -> Array:
    """(C,) class probabilities of an object: its enumerated class, or else from the record of its views."""
    if object_id in component.classes:
        return np.asarray(np.eye(len(log_prior))[component.classes[object_id]])
    views = component.views.get(object_id)
    return class_posterior(log_prior, np.zeros(len(log_prior)) if views is None else views.log_likelihood)


def _by_class(model: ViewpointModel, seen: PlanarDetection) -> Array:
    """(C,) log density of one view under each class from anywhere, up to a constant."""
    count = len(model.class_names)
    around = np.tile(np.linspace(-np.pi, np.pi, AZIMUTHS, endpoint=False), count)
    views = Viewpoints(around, np.zeros(len(around)), np.ones(len(around)))
    prediction = model.predict(np.repeat(np.arange(count), AZIMUTHS), views)
    density = log_density(seen.feature - prediction.mean, prediction.covariance + seen.feature_covariance)
    by_class = np.logaddexp.reduce(density.reshape(count, AZIMUTHS), axis=1)
    return np.asarray(by_class - by_class.max())

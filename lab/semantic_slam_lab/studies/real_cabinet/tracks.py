"""Stretches of views, and models of every class that were fitted without them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.training.viewpoint.regression import fit_class
from semantic_slam.training.viewpoint.samples import ClassSamples
from semantic_slam.viewpoint.gaussian_process import ClassFit, GaussianProcessModel
from semantic_slam_lab.studies.real_cabinet.network import GROUPS, Scores
from semantic_slam_lab.studies.real_cabinet.views import Photograph

CLASSES = tuple(GROUPS)
STRETCHES = 5
"""Parts, one after the other, into which the views of every object are divided."""
LEAST_VIEWS = 4


@dataclass(frozen=True)
class Track:
    """K views of one object, one after the other, and models that saw none of them."""

    object_name: str
    true_class: int  # of CLASSES
    rows: Index  # (K,) of the views
    relative_m: Array  # (K, 2) the camera against the object
    means: Array  # (K, F) scores
    covariances: Array  # (K, F, F)
    model: GaussianProcessModel


def tracks_of(views: Sequence[Photograph], scores: Scores) -> list[Track]:
    """Every stretch of every object that has enough views."""
    azimuths = np.array([view.azimuth_rad for view in views])
    classes = np.array([CLASSES.index(view.class_name) for view in views])
    names = np.array([view.object_name for view in views])
    whole = [_fit(np.flatnonzero(classes == number), azimuths, scores) for number in range(len(CLASSES))]
    tracks = []
    for name in dict.fromkeys(names.tolist()):
        for rows in np.array_split(np.flatnonzero(names == name), STRETCHES):
            if len(rows) < LEAST_VIEWS:
                continue
            own = int(classes[rows[0]])
            left = np.setdiff1d(np.flatnonzero(classes == own), rows)
            fits = [_fit(left, azimuths, scores) if number == own else fit for number, fit in enumerate(whole)]
            relative = np.array([views[row].relative_m for row in rows])
            model = GaussianProcessModel(CLASSES, scores.names, fits)
            tracks.append(Track(name, own, rows, relative, scores.means[rows], scores.covariances[rows], model))
    return tracks


def _fit(rows: Index, azimuths: Array, scores: Scores) -> ClassFit:
    if len(rows) < LEAST_VIEWS:
        raise SemanticSlamError(f"real_cabinet: {len(rows)} views of a class are too few to fit; take more frames")
    samples = ClassSamples(azimuths[rows], scores.means[rows, None], scores.covariances[rows, None])
    return fit_class(samples)

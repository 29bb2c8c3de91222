"""Viewpoint models of two real things, from photographs on a turntable (`coil100`): half of them fit, half test."""

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.perception.networks.weights import load_network
from semantic_slam.training.viewpoint.fit import FitSettings, measure_views
from semantic_slam.training.viewpoint.regression import fit_class
from semantic_slam.training.viewpoint.samples import ClassSamples
from semantic_slam.training.views import ObjectView, cut_out
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.model import Viewpoints, log_likelihood

pytestmark = [pytest.mark.real_data, pytest.mark.slow]

OBJECTS = (5, 24)
"""Two that look alike to the eye, yet have all of their pictures."""
SETTINGS = FitSettings(azimuth_step_deg=10.0, draws=2, num_passes=10)
BLACK = 25
"""Brightest grey level of the background."""
ELEVATION_RAD, RANGE_M = 0.3, 1.0  # stated nowhere, the same for all pictures


def photographs(folder: Path, angles_deg: Iterable[int]) -> list[ObjectView]:
    return [photograph(folder, number, angle) for number in OBJECTS for angle in angles_deg]


def photograph(folder: Path, number: int, angle_deg: int) -> ObjectView:
    picture = cv2.imread(str(folder / f"obj{number}__{angle_deg}.jpg"))[:, :, ::-1]
    cutout, mask = cut_out(picture, picture.max(axis=2) > BLACK)
    return ObjectView(str(number), np.deg2rad(angle_deg), ELEVATION_RAD, RANGE_M, cutout, mask, angle_deg)


def recognised(model: GaussianProcessModel, label: int, samples: ClassSamples) -> np.ndarray:
    """(M * S,) whether the true class is the likeliest of the two from the true direction."""
    found = []
    for azimuth, features, covariances in zip(
        samples.azimuth_rad, samples.features, samples.feature_covariances, strict=True
    ):
        viewpoint = Viewpoints(np.array([azimuth]), np.array([ELEVATION_RAD]), np.array([RANGE_M]))
        for feature, covariance in zip(features, covariances, strict=True):
            found.append(log_likelihood(model, feature, covariance, viewpoint).argmax() == label)
    return np.array(found)


def test_real_things_are_recognised_from_directions_that_were_left_out(data_set: Callable[[str], Path]) -> None:
    """With the shipped network, which has seen drawn furniture alone: what a class is, its viewpoint model says."""
    folder, network = data_set("coil100"), load_network(PerceptionConfiguration())
    fitted = measure_views(photographs(folder, range(0, 360, 10)), network, SETTINGS)
    left_out = measure_views(photographs(folder, range(5, 360, 10)), network, SETTINGS)
    model = GaussianProcessModel(tuple(fitted), network.class_names, [fit_class(data) for data in fitted.values()])
    for label, name in enumerate(fitted):
        assert recognised(model, label, left_out[name]).mean() > 0.9

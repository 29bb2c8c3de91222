"""A classifier measures with what it is handed, and perception knows nothing of those who hand it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.networks.compact_network import CompactNetwork
from semantic_slam.perception.networks.network import ClassifierNetwork
from semantic_slam.perception.range_bearing import RangeBearing

BOXES = np.array([[10.0, 20.0, 70.0, 90.0], [150.0, 60.0, 260.0, 200.0]])
CAMERA = CameraModel(320, 240, 250.0, 250.0, 160.0, 120.0)
FORWARD = np.array([0.1, 0.0, 0.9, -0.5, 0.5, -0.5, 0.5])

ALONE = """
import importlib, pkgutil, sys
import semantic_slam.perception as perception
for module in pkgutil.iter_modules(perception.__path__):
    importlib.import_module(f"{perception.__name__}.{module.name}")
rooms = {name.split(".")[1] for name in sys.modules if name.startswith("semantic_slam.")}
print(*sorted(rooms))
"""


class MeanColour:
    """An extractor that is no network."""

    input_size, num_features = 8, 3

    def features(self, crops: np.ndarray) -> Array:
        return np.asarray(crops.mean(axis=(1, 2)) / 255.0, dtype=np.float64).reshape(-1, 3)


class Reddish:
    """A coverage check: what is more red than anything else is known."""

    def explain(self, feature: Array, feature_covariance: Array) -> bool:
        return bool(feature.argmax() == 0)


def overhead(box: Array, depth_m: object, camera: CameraModel, T_base_camera: Array) -> RangeBearing:
    """A sensor that sees the plane from above, one centimetre a pixel."""
    x, y = 0.01 * (box[:2] + box[2:]) / 2.0
    return RangeBearing(float(np.hypot(x, y)), float(np.arctan2(y, x)), np.eye(2))


@pytest.fixture(scope="module")
def network() -> ClassifierNetwork:
    torch.manual_seed(1)
    return ClassifierNetwork(CompactNetwork(2).eval(), ("chest", "desk"), ((0,), (1,)))


def red_and_blue() -> Frame:
    image = np.zeros((240, 320, 3), dtype=np.uint8)
    image[:, :100, 0] = image[:, 100:, 2] = 200
    detections = Detections(
        stamp_ns=5, frame_id="camera", boxes=BOXES, labels=("", ""), scores=np.full(2, 0.9), track_ids=("", "")
    )
    return Frame(5, image, None, CAMERA, detections)


def test_features_coverage_and_geometry_are_those_of_the_collaborators(network: ClassifierNetwork) -> None:
    classifier = Classifier(
        network,
        PerceptionConfiguration(num_passes=4),
        seed=0,
        range_bearing_sensor=overhead,
        extractor=MeanColour(),
        coverage=Reddish(),
    )
    measured = classifier.measure(red_and_blue(), 0, FORWARD)
    assert classifier.num_features == 3
    np.testing.assert_allclose(measured.features, [[200 / 255, 0.0, 0.0], [0.0, 0.0, 200 / 255]], atol=1e-12)
    assert not measured.feature_covariances.any()
    assert measured.in_coverage.tolist() == [True, False]
    np.testing.assert_allclose(measured.ranges_m, [np.hypot(0.4, 0.55), np.hypot(2.05, 1.3)])


def test_without_them_the_feature_is_the_mean_over_the_passes_and_all_views_are_known(
    network: ClassifierNetwork,
) -> None:
    classifier = Classifier(network, PerceptionConfiguration(num_passes=4), seed=0, range_bearing_sensor=overhead)
    measured = classifier.measure(red_and_blue(), 0, FORWARD)
    np.testing.assert_allclose(measured.features, measured.class_probability_samples.mean(axis=1))
    assert measured.in_coverage.all()


@pytest.mark.slow
def test_perception_needs_neither_class_models_nor_a_latent_space() -> None:
    words = [sys.executable, "-c", ALONE]
    found = subprocess.run(words, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    assert not {"latent", "viewpoint", "inference", "training", "pipeline"} & set(found.stdout.split())

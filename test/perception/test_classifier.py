"""The classifier: keyed dropout, what is dropped and why, uncertainty measures."""

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from semantic_slam.configuration import Configuration, PerceptionConfiguration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception import uncertainty
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.networks.compact_network import CompactNetwork
from semantic_slam.perception.networks.mc_dropout import class_probability_samples, dropout_generator
from semantic_slam.perception.networks.weight_files import shipped_file
from semantic_slam.perception.networks.weights import save_compact_network
from semantic_slam.pipeline.build_classifier import build_classifier

NAMES = ("chest", "crate", "desk")
CAMERA = CameraModel(320, 240, 250.0, 250.0, 160.0, 120.0)
FORWARD = np.array([0.1, 0.0, 0.9, -0.5, 0.5, -0.5, 0.5])
BOXES = [[10.0, 20.0, 70.0, 90.0], [150.0, 60.0, 260.0, 200.0], [100.0, 5.0, 130.0, 60.0]]


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Configuration:
    """A network with random weights: untrained, it answers everything the tests ask."""
    torch.manual_seed(1)
    path = tmp_path_factory.mktemp("network") / "weights.safetensors"
    save_compact_network(CompactNetwork(len(NAMES)), NAMES, {}, path)
    return configured(str(path))


def configured(network: str) -> Configuration:
    perception = PerceptionConfiguration(network=network, num_passes=20)
    return Configuration(seed=7, perception=perception, semantic_model=SemanticModelConfiguration(kind="none"))


def frame(boxes: list[list[float]], labels: list[str] | None = None, stamp_ns: int = 5_000_000_000) -> Frame:
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    count = len(boxes)
    detections = Detections(
        stamp_ns=stamp_ns,
        frame_id="camera",
        boxes=np.array(boxes, dtype=np.float64).reshape(count, 4),
        labels=tuple(labels or ["furniture"] * count),
        scores=np.full(count, 0.9),
        track_ids=("",) * count,
    )
    return Frame(stamp_ns, image, np.full((240, 320), 2.0, dtype=np.float32), CAMERA, detections)


def test_shapes_and_meaning(configuration: Configuration) -> None:
    classifier = build_classifier(configuration)
    measured = classifier.measure(frame(BOXES), 4, FORWARD)
    assert classifier.class_names == measured.class_names == NAMES
    assert classifier.num_features == 3
    assert (measured.stamp_ns, measured.sequence, measured.frame_id) == (5_000_000_000, 4, "base_link")
    assert measured.class_probability_samples.shape == (3, 20, 3)
    np.testing.assert_allclose(measured.class_probability_samples.sum(axis=-1), 1.0)
    np.testing.assert_allclose(measured.features, measured.class_probability_samples.mean(axis=1))
    for index in range(3):
        expected = np.cov(measured.class_probability_samples[index].T)
        np.testing.assert_allclose(measured.feature_covariances[index], expected, atol=1e-15)
    assert measured.detection_ids.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(measured.sensor_position, [0.1, 0.0, 0.9])
    assert measured.ranges_m.shape == measured.bearings_rad.shape == (3,)
    assert measured.geometric_covariances.shape == (3, 2, 2)
    assert np.all(measured.mutual_information > 0.0)
    assert np.all(measured.mutual_information <= measured.predictive_entropy)


def test_a_detection_measures_the_same_alone_and_in_company(configuration: Configuration) -> None:
    """Only seed, stamp and index count: boxes without area around it change neither its index nor its samples."""
    together = build_classifier(configuration).measure(frame(BOXES), 0, FORWARD)
    nothing = [0.0, 0.0, 0.0, 0.0]
    alone = build_classifier(configuration).measure(frame([nothing, BOXES[1], nothing]), 0, FORWARD)
    assert alone.detection_ids.tolist() == [1]
    np.testing.assert_array_equal(alone.class_probability_samples[0], together.class_probability_samples[1])


def test_draws_differ_by_seed_stamp_and_index(configuration: Configuration) -> None:
    same_box = [BOXES[1], BOXES[1]]
    first = build_classifier(configuration).measure(frame(same_box), 0, FORWARD).class_probability_samples
    later = build_classifier(configuration).measure(frame(same_box, stamp_ns=6), 0, FORWARD).class_probability_samples
    other = (
        build_classifier(replace(configuration, seed=8)).measure(frame(same_box), 0, FORWARD).class_probability_samples
    )
    assert not np.array_equal(first[0], first[1])
    assert not np.array_equal(first[0], later[0])
    assert not np.array_equal(first[0], other[0])


@pytest.mark.long
@pytest.mark.slow
def test_another_process_draws_the_same(configuration: Configuration) -> None:
    script = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from test_classifier import *\n"
        "m = build_classifier(configured(sys.argv[2])).measure(frame(BOXES), 0, FORWARD)\n"
        "print(hashlib.sha256(m.class_probability_samples.tobytes()).hexdigest())\n"
    )
    here = build_classifier(configuration).measure(frame(BOXES), 0, FORWARD).class_probability_samples
    words = [sys.executable, "-c", script, str(Path(__file__).parent), configuration.perception.network]
    there = subprocess.run(words, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    assert there.stdout.strip() == hashlib.sha256(here.tobytes()).hexdigest()


@pytest.mark.long
@pytest.mark.slow
def test_trunk_once_has_the_distribution_of_whole_passes() -> None:
    """Against torch's own dropout, the whole network run again for each pass: equal mean and covariance."""
    torch.manual_seed(3)
    network = CompactNetwork(3)
    for layer in network.head():
        if isinstance(layer, torch.nn.Linear):
            layer.weight.data *= 3.0  # wider logits, so that dropout matters
    crop = np.random.default_rng(2).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    ours = class_probability_samples(network.eval(), crop, 2000, dropout_generator(0, 0, 0))
    network.classifier.train()
    with torch.inference_mode():
        image = network.normalise(crop[None])
        passes = [torch.softmax(network(image.expand(100, -1, -1, -1)).double(), -1).numpy() for _ in range(20)]
    literal = np.concatenate(passes)
    error = np.sqrt((ours.var(axis=0) + literal.var(axis=0)) / 2000)
    assert literal.std(axis=0).min() > 0.01
    assert np.all(np.abs(ours.mean(axis=0) - literal.mean(axis=0)) < 4.0 * error)
    np.testing.assert_allclose(np.cov(ours.T), np.cov(literal.T), atol=0.2 * literal.var(axis=0).max())


def test_unusable_boxes_are_counted_by_reason(configuration: Configuration) -> None:
    boxes = [
        BOXES[0],
        [50.0, 50.0, 50.0, 80.0],
        [np.nan, 0.0, 10.0, 10.0],
        [400.0, 10.0, 500.0, 60.0],
        [90.0, 80.0, 60.0, 120.0],
    ]
    classifier = build_classifier(configuration)
    measured = classifier.measure(frame(boxes), 0, FORWARD)
    assert measured.detection_ids.tolist() == [0]
    assert dict(classifier.dropped) == {
        "box without area": 2,
        "box that is not finite": 1,
        "box outside the image": 1,
    }
    assert measured.dropped == 4
    assert classifier.measure(frame(boxes), 1, FORWARD).dropped == 8


def test_unknown_labels_are_counted_by_name(configuration: Configuration) -> None:
    chosen = replace(configuration, perception=replace(configuration.perception, labels=("furniture",)))
    classifier = build_classifier(chosen)
    measured = classifier.measure(frame(BOXES, ["furniture", "cat", "cat"]), 0, FORWARD)
    assert measured.labels == ("furniture",)
    assert dict(classifier.dropped) == {"unknown label 'cat'": 2}


def test_no_detections_give_an_empty_measurement(configuration: Configuration) -> None:
    measured = build_classifier(configuration).measure(frame([]), 0, FORWARD)
    assert len(measured) == 0
    assert measured.boxes.shape == (0, 4)
    assert measured.class_probability_samples.shape == (0, 20, 3)
    assert measured.features.shape == (0, 3)
    assert measured.feature_covariances.shape == (0, 3, 3)
    assert measured.geometric_covariances.shape == (0, 2, 2)
    assert measured.dropped == 0


def test_boxes_over_the_border_and_of_one_pixel_are_measured(configuration: Configuration) -> None:
    boxes = [[-30.0, -30.0, 40.0, 40.0], [300.0, 200.0, 1e9, 1e9], [100.2, 100.2, 100.4, 100.4]]
    measured = build_classifier(configuration).measure(frame(boxes), 0, FORWARD)
    assert len(measured) == 3
    assert np.isfinite(measured.features).all()


def test_one_pass_has_no_spread(configuration: Configuration) -> None:
    single = replace(configuration, perception=replace(configuration.perception, num_passes=1))
    measured = build_classifier(single).measure(frame(BOXES), 0, FORWARD)
    np.testing.assert_array_equal(measured.feature_covariances, 0.0)


def test_crops_keep_the_aspect_ratio() -> None:
    """A bright box of 20 x 40 in the dark: 1.2 x 40 pixels become 64, so it covers 26.7 x 53.3 of the crop."""
    image = np.zeros((100, 100, 3), dtype=np.uint8)
    image[30:70, 40:60] = 255
    crop = square_crop(image, np.array([40.0, 30.0, 60.0, 70.0]), 64)
    assert crop.shape == (64, 64, 3)
    assert (crop[32, :, 0] > 127).sum() == pytest.approx(64 * 20 / 48, abs=2)
    assert (crop[:, 32, 0] > 127).sum() == pytest.approx(64 * 40 / 48, abs=2)


def test_mutual_information_limits() -> None:
    """Passes that agree: none of the entropy is the model's. Passes that are certain and disagree: all of it."""
    agree = np.tile([0.5, 0.5], (10, 1))
    disagree = np.tile(np.eye(2), (5, 1))
    assert uncertainty.predictive_entropy(agree) == pytest.approx(np.log(2.0))
    assert uncertainty.mutual_information(agree) == pytest.approx(0.0, abs=1e-12)
    assert uncertainty.predictive_entropy(disagree) == pytest.approx(np.log(2.0))
    assert uncertainty.mutual_information(disagree) == pytest.approx(np.log(2.0))


@pytest.mark.parametrize("content", [None, b"", b"not a network", b"\x08\x00\x00\x00\x00\x00\x00\x00{}      "])
def test_wrong_weights_are_named(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "weights.safetensors"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"weights\.safetensors: ") as error:
        build_classifier(Configuration(perception=PerceptionConfiguration(network=str(path))))
    assert "\n" not in str(error.value)


def test_a_trained_network_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        save_compact_network(CompactNetwork(len(NAMES)), NAMES, {}, tmp_path / "network.safetensors")
    finally:
        os.umask(before)
    assert (tmp_path / "network.safetensors").stat().st_mode & 0o777 == 0o644


def test_the_shipped_network_is_small_and_describes_itself() -> None:
    classifier = build_classifier(Configuration())
    assert len(classifier.class_names) >= 3
    assert shipped_file("compact_network.safetensors").stat().st_size < 5_000_000

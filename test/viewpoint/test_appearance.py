"""Novelty of pictures: honest about known objects, kept with the models, and told by the shipped ones."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from worlds.views.synthetic_views import FEATURES, synthetic_samples

from semantic_slam.class_models.viewpoint_models import shipped_models
from semantic_slam.configuration import Configuration, PerceptionConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.networks.mc_dropout import probe_features, trunk_features
from semantic_slam.perception.networks.weights import load_network
from semantic_slam.perception.range_bearing import range_and_bearing
from semantic_slam.pipeline.build_classifier import build_classifier
from semantic_slam.training.appearance import fit_appearance
from semantic_slam.training.other_things import other_crop
from semantic_slam.training.viewpoint.fit import other_features
from semantic_slam.training.viewpoint.regression import fit_class
from semantic_slam.viewpoint.appearance import KnownAppearance, KnownPictures
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.store import FORMAT, read_appearance, save_model

NUM_FEATURES, NUM_CLASSES = 30, 4
RATES = (0.2, 0.05, 0.01)


def pictures(count: int, generator: np.random.Generator, classes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Features (N, K) of pictures of random classes, which differ in what excites them, by gamma variables."""
    labels = generator.integers(len(classes), size=count)
    return generator.gamma(4.0 * classes[labels]), labels


@pytest.fixture(scope="module")
def classes() -> np.ndarray:
    return np.random.default_rng(0).gamma(0.5, size=(NUM_CLASSES, NUM_FEATURES)) + 0.1


@pytest.fixture(scope="module")
def known(classes: np.ndarray) -> KnownAppearance:
    features, labels = pictures(5000, np.random.default_rng(1), classes)
    found = fit_appearance(features, labels, np.arange(5000), other_things(6), np.ones(NUM_FEATURES))
    assert found is not None
    return found


def other_things(seed: int) -> np.ndarray:
    """Features (N, K) of pictures of many other classes."""
    generator = np.random.default_rng(seed)
    many = generator.gamma(0.5, size=(100, NUM_FEATURES)) + 0.1
    return pictures(1000, generator, many)[0]


def is_novel(appearance: KnownAppearance, features: np.ndarray, false_alarms: float) -> np.ndarray:
    """(N,) whether pictures with (N, K) features look like no known object, as ``KnownPictures`` says of each."""
    return appearance.novelty(features) > appearance.limit(false_alarms)


@pytest.mark.parametrize("rate", RATES)
def test_of_new_pictures_of_known_objects_the_stated_share_is_taken_for_others(
    known: KnownAppearance, classes: np.ndarray, rate: float
) -> None:
    """Exact but for chance: 1000 pictures set the limit, 4000 test it."""
    features, _ = pictures(4000, np.random.default_rng(2), classes)
    error = np.sqrt(rate * (1.0 - rate) * (1.0 / 1000.0 + 1.0 / 4000.0))
    assert is_novel(known, features, rate).mean() == pytest.approx(rate, abs=4.0 * error)


def test_what_excites_other_features_is_novel_however_bright(known: KnownAppearance, classes: np.ndarray) -> None:
    other = np.random.default_rng(3).gamma(0.5, size=(NUM_CLASSES, NUM_FEATURES)) + 0.1
    features, _ = pictures(500, np.random.default_rng(4), other)
    assert is_novel(known, features, 0.05).mean() > 0.95
    assert np.array_equal(is_novel(known, features, 0.05), is_novel(known, 7.0 * features, 0.05))


def test_too_few_directions_of_view_tell_nothing(classes: np.ndarray) -> None:
    features, labels = pictures(50, np.random.default_rng(1), classes)
    assert fit_appearance(features, labels, np.arange(50) % 9, other_things(6), np.ones(NUM_FEATURES)) is None


def test_appearance_is_kept_with_the_models_and_absent_from_older_files(known: KnownAppearance, tmp_path: Path) -> None:
    model = GaussianProcessModel(("one",), FEATURES, [fit_class(synthetic_samples(0.0, 0))])
    save_model(model, tmp_path / "old.safetensors", {})
    save_model(model, tmp_path / "new.safetensors", {}, known)
    assert read_appearance(tmp_path / "old.safetensors") is None
    again = read_appearance(tmp_path / "new.safetensors")
    assert again is not None
    np.testing.assert_allclose(again.coordinates, known.coordinates, rtol=1e-6)
    features = np.random.default_rng(5).gamma(1.0, size=(100, NUM_FEATURES))
    np.testing.assert_allclose(again.novelty(features), known.novelty(features), atol=0.02)


def test_a_file_that_tells_it_as_an_earlier_version_did_tells_nothing(tmp_path: Path) -> None:
    path = tmp_path / "models.safetensors"
    save_model(GaussianProcessModel(("one",), FEATURES, [fit_class(synthetic_samples(0.0, 0))]), path, {})
    arrays, description = FORMAT.read(path)
    FORMAT.write(path, arrays | {"appearance.class_means": np.zeros((1, 3), dtype=np.float32)}, description)
    assert read_appearance(path) is None


@pytest.mark.parametrize(
    ("name", "value"),
    [("scale", np.zeros(NUM_FEATURES)), ("coordinates", np.ones((3, 3))), ("centre", np.full(NUM_FEATURES, np.nan))],
)
def test_a_damaged_appearance_is_one_line(known: KnownAppearance, tmp_path: Path, name: str, value: np.ndarray) -> None:
    path = tmp_path / "models.safetensors"
    save_model(GaussianProcessModel(("one",), FEATURES, [fit_class(synthetic_samples(0.0, 0))]), path, {}, known)
    arrays, description = FORMAT.read(path)
    FORMAT.write(path, arrays | {f"appearance.{name}": value.astype(np.float32)}, description)
    with pytest.raises(InputError, match=r"models\.safetensors: .*known appearance") as fault:
        read_appearance(path)
    assert "\n" not in str(fault.value)


def test_another_network_is_told_by_what_it_makes_of_one_picture() -> None:
    shipped = load_network(PerceptionConfiguration()).network
    probe = probe_features(shipped)
    features = np.random.default_rng(0).gamma(1.0, size=(100, len(probe)))
    found = fit_appearance(features, np.zeros(100, dtype=int), np.arange(100), features[::2], probe)
    assert found is not None and found.is_about(probe_features(shipped))
    assert not found.is_about(1.1 * probe) and not found.is_about(probe[:-1])


def coloured_blocks(generator: np.random.Generator, size: int) -> np.ndarray:
    picture = np.full((size, size, 3), generator.integers(0, 256, 3), dtype=np.uint8)
    for _ in range(generator.integers(0, 5)):
        x, y = np.sort(generator.integers(0, size, (2, 2)), axis=1)
        picture[y[0] : y[1] + 8, x[0] : x[1] + 8] = generator.integers(0, 256, 3)
    return picture


def test_to_the_shipped_models_noise_and_coloured_blocks_are_unknown() -> None:
    """At 5 % false alarms at least 99 % of them; at the default rate every picture of independent pixels."""
    generator = np.random.default_rng(0)
    network, known = load_network(PerceptionConfiguration()).network, read_appearance(shipped_models())
    assert known is not None and known.is_about(probe_features(network))
    noise = trunk_features(network, generator.integers(0, 256, (150, 64, 64, 3), dtype=np.uint8))
    blocks = trunk_features(network, np.array([coloured_blocks(generator, 64) for _ in range(150)]))
    assert is_novel(known, noise, 0.05).mean() >= 0.99 and is_novel(known, blocks, 0.05).mean() >= 0.99
    assert is_novel(known, noise, PerceptionConfiguration().novelty_false_alarms).all()


def test_the_classifier_says_that_a_box_of_noise_is_out_of_coverage() -> None:
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    detections = Detections(
        stamp_ns=5,
        frame_id="camera",
        boxes=np.array([[20.0, 20.0, 120.0, 120.0]]),
        labels=("",),
        scores=np.ones(1),
        track_ids=("",),
    )
    frame = Frame(5, image, None, CameraModel(320, 240, 250.0, 250.0, 160.0, 120.0), detections)
    forward = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
    classifier = build_classifier(Configuration(perception=PerceptionConfiguration(num_passes=5)))
    assert classifier.measure(frame, 0, forward).in_coverage.tolist() == [False]
    alone = classifier_without_class_models(false_alarms=0.01)
    assert alone.measure(frame, 0, forward).in_coverage.tolist() == [False]  # whatever the class models make of scores


def classifier_without_class_models(false_alarms: float) -> Classifier:
    settings = PerceptionConfiguration(num_passes=5)
    known = read_appearance(shipped_models())
    assert known is not None
    return Classifier(
        load_network(settings),
        settings,
        seed=0,
        range_bearing_sensor=partial(range_and_bearing, configuration=settings),
        appearance=KnownPictures(known, false_alarms),
    )


@pytest.mark.long
@pytest.mark.real_data
def test_photographs_of_things_left_out_are_unknown(data_set: Callable[[str], Path]) -> None:
    """12 things on a turntable, every 20 degrees; known views from between, and 12 other things."""
    folder, network = data_set("coil100"), load_network(PerceptionConfiguration()).network

    def seen(numbers: range, angles: range) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rows = [(n, a) for n in numbers for a in angles if (folder / f"obj{n}__{a}.jpg").is_file()]
        crops = [photograph(folder / f"obj{n}__{a}.jpg", network.input_size) for n, a in rows]
        return trunk_features(network, np.array(crops)), *np.array(rows).T

    features, numbers, angles = seen(range(2, 14), range(0, 360, 20))
    others = other_features(network, len(features))
    known = fit_appearance(features, numbers, angles // 20, others, probe_features(network))
    assert known is not None
    assert is_novel(known, seen(range(2, 14), range(10, 360, 60))[0], 0.05).mean() < 0.1
    assert is_novel(known, seen(range(22, 34), range(10, 360, 60))[0], 0.05).mean() > 0.8


@pytest.mark.real_data
def test_to_the_shipped_models_photographs_are_unknown(data_set: Callable[[str], Path]) -> None:
    """54 things on a turntable, cut to the object, at 5 % false alarms."""
    network, known = load_network(PerceptionConfiguration()).network, read_appearance(shipped_models())
    paths = sorted(data_set("coil100").glob("obj*__60.jpg")) + sorted(data_set("coil100").glob("obj*__240.jpg"))
    features = trunk_features(network, np.array([photograph(path, network.input_size) for path in paths]))
    assert known is not None and is_novel(known, features, 0.05).mean() >= 0.8


def test_things_that_are_made_up_differ_and_are_the_same_again() -> None:
    drawn = [[other_crop(32, np.random.default_rng(seed)) for seed in range(20)] for _ in range(2)]
    assert np.array_equal(*map(np.array, drawn)) and drawn[0][0].shape == (32, 32, 3)
    means = np.array([crop.mean(axis=(0, 1)) for crop in drawn[0]])
    assert (means.std(axis=0) > 15.0).all()


def photograph(path: Path, size: int) -> np.ndarray:
    picture = cv2.imread(str(path))[..., ::-1]
    rows, columns = np.nonzero(picture.max(axis=2) > 25)
    box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], dtype=np.float64)
    return square_crop(picture, box, size)

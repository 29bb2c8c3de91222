"""How an object's looks change by direction is learned from runs; the next run uses it, or stays as it was."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import of_topic, write_bag, write_configuration
from worlds.bags.places import place_entries

from semantic_slam.answers.appearances import SeenView
from semantic_slam.class_models.embedding import embedding_model, load_embedding_model
from semantic_slam.configuration import SemanticModelConfiguration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.training.embeddings.learn import RunLooks, Told, learn_embeddings, lines_of
from semantic_slam.training.labels.runs import Run, read_runs
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
from semantic_slam.viewpoint.embeddings.store import (
    FittedEmbeddings,
    LooksByDirection,
    read_embeddings,
    save_embeddings,
)

SIZE, REACH, SPREAD, NOISE = 24, 1.4, 0.35, 0.01
SETTINGS = SemanticModelConfiguration(kind="embedding", embedding_dimensions=SIZE)
MODEL = embedding_model(SETTINGS)
BACKGROUND = EmbeddingBackground(centre=np.zeros(SIZE), spread=1.0, dimensions=float(SIZE))


def drawn(model: EmbeddingModel, seed: int, objects: int = 5, views: int = 12) -> RunLooks:
    """Objects whose views are drawn from the model itself, with settings SPREAD and NOISE."""
    random, found = np.random.default_rng(seed), list[SeenView]()
    row = int(np.flatnonzero((model.settings[0] == SPREAD) & (model.settings[1] == NOISE))[0])
    for number in range(objects):
        directions = random.uniform(-np.pi, np.pi) + 2.0 * np.pi * np.arange(views) / views
        places = CameraPlaces.level(directions)
        covariance = model.kernel(places, places)[row] + NOISE * np.eye(views) + 1.0 - SPREAD - NOISE
        root = np.linalg.cholesky(covariance)
        vectors = root @ random.normal(0.0, 1.0 / np.sqrt(SIZE), (views, SIZE))
        found += [
            SeenView(object_id=number, vector=vector, place=CameraPlaces.one(float(own), 0.0))
            for vector, own in zip(vectors, directions, strict=True)
        ]
    return RunLooks(views=found, background=BACKGROUND, sizes=frozenset({SIZE}))


def test_how_far_looks_reach_and_how_different_sides_are_is_told_by_runs() -> None:
    true = replace(MODEL, repeat_rad=REACH, outlier_share=0.0)
    told = Told(model=MODEL, runs=[drawn(true, seed) for seed in range(3)])
    assert told.after > told.before + 50.0
    found = told.learned(range(3))
    assert found.repeat_rad == REACH
    shares = np.array(found.counts) @ MODEL.settings[0] / sum(found.counts)
    assert shares == pytest.approx(SPREAD, abs=0.08)
    assert sum(found.counts) == pytest.approx(1.0 + 15.0, abs=1e-9)


def test_the_evidence_of_views_is_that_of_one_gaussian() -> None:
    """Of one object under one setting, without outliers: relative to the background's."""
    model = replace(MODEL, spread_shares=(SPREAD,), noise_shares=(NOISE,), outlier_share=0.0)
    own = drawn(model, 4, objects=1, views=6)
    vectors = np.array([view.vector for view in own.views])
    places = CameraPlaces.level(np.concatenate([view.place.azimuths_rad for view in own.views]))
    covariance = model.kernel(places, places)[0] + NOISE * np.eye(6) + 1.0 - SPREAD - NOISE
    products, (_, log_determinant) = vectors @ vectors.T, np.linalg.slogdet(covariance)
    exact = -0.5 * SIZE * (np.trace(np.linalg.solve(covariance, products) - products) + log_determinant)
    assert own.told(model)[0] == pytest.approx(exact)


def test_a_run_takes_what_other_bags_tell(tmp_path: Path) -> None:
    counts = tuple(np.linspace(0.1, 2.0, len(MODEL.within)).tolist())
    whole, other = (LooksByDirection(repeat_rad=own, counts=counts) for own in (1.4, 0.7))
    fitted = FittedEmbeddings(
        dimensions=SIZE,
        spread_shares=MODEL.spread_shares,
        noise_shares=MODEL.noise_shares,
        whole=whole,
        without={"ab": other},
        report={"views": 3},
    )
    path = tmp_path / "looks.safetensors"
    save_embeddings(fitted, path)
    assert read_embeddings(path) == fitted
    settings = replace(SETTINGS, path=str(path))
    for sha256, reach in (("cd", 1.4), ("ab", 0.7)):
        model = load_embedding_model(settings, sha256)
        assert model is not None and model.repeat_rad == reach
        np.testing.assert_allclose(np.exp(model.usual(np.zeros(len(counts)))), np.array(counts) / sum(counts))
    with pytest.raises(InputError, match="other embedding_dimensions"):
        load_embedding_model(replace(settings, embedding_dimensions=32))
    save_embeddings(replace(fitted, whole=LooksByDirection(repeat_rad=1.0, counts=(1.0,))), path)
    with pytest.raises(InputError, match="counts must be one for each setting"):
        read_embeddings(path)


def run_with(looks: np.ndarray, folder: Path) -> Run:
    """A run whose two detections of each keyframe have these vectors, (2, F)."""
    entries = place_entries("ranges")
    for entry in of_topic(entries, topics.DETECTIONS):
        found = from_message(entry.message)
        entry.message = to_message(replace(found, embeddings=looks[: len(found)]))
    settings = {"association": "open", "semantic_model": {"kind": "embedding"}}
    configuration = load_configuration(write_configuration(folder / "configuration", **settings))
    run_bag(write_bag(folder / "bag", entries), folder / "run" / "belief", configuration)
    (run,) = read_runs([folder / "run"])
    return run


def test_one_run_is_not_enough(tmp_path: Path) -> None:
    found = learn_embeddings([run_with(np.random.default_rng(0).normal(size=(2, 40)), tmp_path)])
    assert found.whole is None and found.report["views"] == 8
    (line,) = lines_of(found)
    assert line.startswith("one run alone cannot be judged by another")


def test_vectors_of_zeros_tell_nothing_and_those_of_two_networks_are_not_mixed(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    short, long = (run_with(random.normal(size=(2, size)), tmp_path / str(size)) for size in (40, 48))
    with pytest.raises(InputError, match=r"embeddings of \[40, 48\] components are mixed; give runs of one network"):
        learn_embeddings([short, long])
    half = run_with(np.array([random.normal(size=40), np.zeros(40)]), tmp_path / "half")
    assert learn_embeddings([short, half]).report["views"] == 8 + 4

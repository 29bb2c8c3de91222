"""How an object's looks change by direction is learned from runs; the next run uses it, or stays as it was."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import of_topic, write_bag, write_configuration
from worlds.bags.places import place_entries

from semantic_slam.class_models.embedding import embedding_model, load_embedding_model
from semantic_slam.configuration import SemanticModelConfiguration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.training.embeddings.learn import OUTLIER_SHARES, Told, learn_embeddings, looks_of
from semantic_slam.training.embeddings.looks import STRETCHES, LookTrack, LookView, RunLooks
from semantic_slam.training.embeddings.replay import Replay, Usual, judged, rows_of
from semantic_slam.training.embeddings.report import lines_of
from semantic_slam.training.runs import Run, read_runs
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
from semantic_slam.viewpoint.embeddings.store import (
    FORMAT,
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
    """Objects whose views are drawn from the model itself, with settings SPREAD and NOISE and its outliers."""
    random, tracks = np.random.default_rng(seed), list[LookTrack]()
    row = int(np.flatnonzero((model.settings[0] == SPREAD) & (model.settings[1] == NOISE))[0])
    for number in range(objects):
        directions = random.uniform(-np.pi, np.pi) + 2.0 * np.pi * np.arange(views) / views
        places = CameraPlaces.level(directions)
        covariance = model.kernel(places, places)[row] + NOISE * np.eye(views) + 1.0 - SPREAD - NOISE
        root = np.linalg.cholesky(covariance)
        vectors = root @ random.normal(0.0, 1.0 / np.sqrt(SIZE), (views, SIZE))
        strange = random.random(views) < model.outlier_share
        vectors[strange] = random.normal(0.0, 1.0 / np.sqrt(SIZE), (strange.sum(), SIZE))
        found = [
            LookView(keyframe=k, detection=number, stretch=STRETCHES * k // views, vector=own, place=places.take([k]))
            for k, own in enumerate(vectors)
        ]
        tracks.append(LookTrack(object_id=number, views=tuple(found), weight=1.0))
    return RunLooks(tracks=tracks, background=BACKGROUND)


def test_how_far_looks_reach_and_how_different_sides_are_is_told_by_runs() -> None:
    true = replace(MODEL, repeat_rad=REACH, outlier_share=0.0)
    told = Told(model=MODEL, runs=[drawn(true, seed) for seed in range(3)])
    assert told.after.log_evidence > told.before.log_evidence + 50.0
    found = told.learned()
    assert found.repeat_rad == REACH and found.outlier_share == min(OUTLIER_SHARES)
    shares = np.array(found.counts) @ MODEL.settings[0] / sum(found.counts)
    assert shares == pytest.approx(SPREAD, abs=0.08)
    assert sum(found.counts) == pytest.approx(1.0 + 15.0, abs=1e-9)
    assert learn_embeddings(told, ["a", "b", "c"]).without["b"] == told.learned((1, None))


@pytest.mark.long
def test_how_many_views_tell_nothing_is_told_by_runs() -> None:
    """It is found rather too small: an outlier among the first views is taken for what the object looks like."""
    runs = [drawn(replace(MODEL, outlier_share=0.1), seed, objects=8) for seed in range(2)]
    told = Told(model=replace(MODEL, outlier_share=0.01), runs=runs)
    assert told.learned().outlier_share in (0.05, 0.1)
    assert told.after.log_evidence > told.before.log_evidence + 10.0


def test_a_single_run_is_judged_by_its_stretches_and_fitted_without_itself_for_itself() -> None:
    told = Told(model=MODEL, runs=[drawn(replace(MODEL, repeat_rad=REACH, outlier_share=0.0), 3)])
    assert told.after.log_evidence > told.before.log_evidence + 5.0
    fitted = learn_embeddings(told, ["own"])
    assert fitted.whole == told.learned() and fitted.whole.repeat_rad > MODEL.repeat_rad
    itself = fitted.model(MODEL, "own")
    assert (itself.repeat_rad, itself.outlier_share) == (MODEL.repeat_rad, MODEL.outlier_share)
    np.testing.assert_allclose(itself.usual(np.zeros(18)), MODEL.usual(np.zeros(18)))


def test_a_stretch_is_predicted_given_the_rest_and_judged_by_pairs() -> None:
    """The evidence of a stretch after the rest is that of the whole without that of the rest, but for the order."""
    looks = drawn(replace(MODEL, outlier_share=0.0), 5, objects=2)
    one = replace(MODEL, spread_shares=(SPREAD,), noise_shares=(NOISE,), outlier_share=0.0)
    rest, left = rows_of(looks, 2)
    whole = judged(looks, one, None).log_evidence
    part = judged(looks, one, 2)
    assert Replay(looks, one).see(rest) + part.log_evidence == pytest.approx(whole, abs=1e-6)
    assert len(part.answers) == len(left) - 1  # the first has no earlier view of another object to be held against
    right = part.probabilities[np.arange(len(part.answers)), part.answers]
    assert right.min() > 0.5 and set(part.answers.tolist()) == {0, 1}


def test_views_count_by_the_probability_that_they_are_of_one_object() -> None:
    """Two histories of one object: neither tells the other which settings are usual."""
    (track,) = drawn(MODEL, 6, objects=1).tracks
    sure, half = ([replace(track, weight=weight)] * count for weight, count in ((1.0, 1), (0.5, 2)))
    told = [Replay(RunLooks(tracks=own, background=BACKGROUND), MODEL) for own in (sure, half)]
    evidence = [replay.see(rows_of(replay.looks, None)[0]) for replay in told]
    assert evidence[0] == pytest.approx(evidence[1])
    prior = np.full(18, 1.0 / 18.0)
    np.testing.assert_allclose(told[0].usual.counts(prior), told[1].usual.counts(prior))


def test_shares_of_settings_are_the_most_likely_ones() -> None:
    """Against a search over the two shares of two settings; half an object is spread evenly before."""
    logs, weights = np.log([[0.9, 0.2], [0.5, 0.6], [0.1, 0.8], [0.3, 0.4]]), np.array([1.0, 1.0, 0.4, 0.8])
    shares = np.linspace(1e-4, 1.0 - 1e-4, 20001)
    mixed = np.log(np.exp(logs) @ np.stack([shares, 1.0 - shares]))
    posterior = weights @ mixed + 0.5 * (np.log(shares) + np.log(1.0 - shares))
    counts = Usual(log_likelihoods=logs, weights=weights).counts(np.full(2, 0.5))
    assert counts[0] / counts.sum() == pytest.approx(shares[posterior.argmax()], abs=1e-3)
    assert counts.sum() == pytest.approx(1.0 + weights.sum())


def test_the_evidence_of_views_is_that_of_one_gaussian() -> None:
    """Of one object under one setting, without outliers: relative to the background's."""
    model = replace(MODEL, spread_shares=(SPREAD,), noise_shares=(NOISE,), outlier_share=0.0)
    looks = drawn(model, 4, objects=1, views=6)
    vectors = np.array([view.vector for view in looks.tracks[0].views])
    places = CameraPlaces.level(np.concatenate([view.place.azimuths_rad for view in looks.tracks[0].views]))
    covariance = model.kernel(places, places)[0] + NOISE * np.eye(6) + 1.0 - SPREAD - NOISE
    products, (_, log_determinant) = vectors @ vectors.T, np.linalg.slogdet(covariance)
    exact = -0.5 * SIZE * (np.trace(np.linalg.solve(covariance, products) - products) + log_determinant)
    assert judged(looks, model, None).log_evidence == pytest.approx(exact)


def test_a_run_takes_what_other_bags_tell(tmp_path: Path) -> None:
    counts = tuple(np.linspace(0.1, 2.0, len(MODEL.within)).tolist())
    whole, other = (LooksByDirection(repeat_rad=own, counts=counts, outlier_share=0.01) for own in (1.4, 0.7))
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
        assert model is not None and (model.repeat_rad, model.outlier_share) == (reach, 0.01)
        np.testing.assert_allclose(np.exp(model.usual(np.zeros(len(counts)))), np.array(counts) / sum(counts))
    with pytest.raises(InputError, match="other embedding_dimensions"):
        load_embedding_model(replace(settings, embedding_dimensions=32))
    save_embeddings(replace(fitted, whole=LooksByDirection(repeat_rad=1.0, counts=(1.0,))), path)
    with pytest.raises(InputError, match="counts must be one for each setting"):
        read_embeddings(path)
    for wrong in ([1, 2], "looks", 3):
        FORMAT.write(path, {"none": np.zeros(1)}, {**FORMAT.read(path)[1], "whole": wrong})
        with pytest.raises(InputError, match="incomplete models of vectors"):
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


def test_too_few_views_leave_the_models_as_they_were(tmp_path: Path) -> None:
    found = learn_embeddings(looks_of([run_with(np.random.default_rng(0).normal(size=(2, 40)), tmp_path)]), ["own"])
    assert found.whole is None and not found.without and found.report["views"] == 8
    (line,) = lines_of(found.report)
    assert line.startswith("vectors: too little to learn from, so their models are as before any fit: held-out log")


def test_vectors_of_zeros_tell_nothing_and_those_of_two_networks_are_not_mixed(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    short, long = (run_with(random.normal(size=(2, size)), tmp_path / str(size)) for size in (40, 48))
    with pytest.raises(InputError, match=r"embeddings of \[40, 48\] components are mixed; give runs of one network"):
        looks_of([short, long])
    half = run_with(np.array([random.normal(size=40), np.zeros(40)]), tmp_path / "half")
    assert sum(own.num_views for own in looks_of([short, half]).runs) == 8 + 4

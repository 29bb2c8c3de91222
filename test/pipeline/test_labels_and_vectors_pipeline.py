"""Labels and vectors together: from a bag by the command line to objects that have names and are found by looks."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import Entry, of_topic, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.bags.vectors import LOOKS, looking

from semantic_slam.answers.appearances import appearances_of
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.class_models.detector import fitted_labels, load_label_model
from semantic_slam.class_models.embedding import embedding_model, load_embedding_model
from semantic_slam.cli.commands import main
from semantic_slam.configuration import SemanticModelConfiguration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record
from semantic_slam.inference.world.map_prior import read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.viewpoint.embeddings.store import FittedEmbeddings, LooksByDirection, save_embeddings
from semantic_slam.viewpoint.labels.store import read_labels, save_labels

FRAMES, LABELS = 17, ("chair", "cup")
BOTH = {"kind": "detector_embedding"}
SETTINGS = SemanticModelConfiguration(kind="detector_embedding", labels=LABELS)


def entries() -> list[Entry]:
    """Two objects with a label and a look each."""
    found = looking(place_entries("ranges", FRAMES))
    for entry in of_topic(found, topics.DETECTIONS):
        told = from_message(entry.message)
        entry.message = to_message(replace(told, labels=LABELS[: len(told)]))
    return found


def configured(folder: Path, model: dict[str, Any], **others: Any) -> Path:
    return write_configuration(folder, **{"association": "open", "semantic_model": model} | others)


def call(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr("sys.argv", ["semantic_slam", *map(str, words)])
    with pytest.raises(SystemExit) as left:
        main()
    assert isinstance(left.value.code, int)
    return left.value.code


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the report of such a bag, by the command line."""
    folder = tmp_path_factory.mktemp("both")
    bag, settings = write_bag(folder / "bag", entries()), configured(folder / "configuration", BOTH)
    with pytest.MonkeyPatch.context() as patch:
        assert call(patch, "report", bag, "--out", folder / "out", "--config", settings) == 0
    return folder / "out"


def alone(folder: Path, kind: str) -> Record:
    """The record of a run by labels, or by vectors alone."""
    settings = load_configuration(configured(folder / "configuration", {"kind": kind}))
    run_bag(write_bag(folder / "bag", entries()), folder / "belief", settings)
    return read_record(folder / "belief")


def test_objects_are_named_as_by_labels_and_have_the_looks_that_vectors_give(reported: Path, tmp_path: Path) -> None:
    last = read_record(reported / "belief").beliefs[-1]
    named, looked = (alone(tmp_path / kind, kind).beliefs[-1] for kind in ("detector", "embedding"))
    there = last.existence > 0.5
    assert there.sum() == 2
    assert last.class_names == named.class_names == (*LABELS, "none of these")
    np.testing.assert_allclose(last.class_probabilities[there], named.class_probabilities[named.existence > 0.5])
    np.testing.assert_allclose(last.descriptors[there], looked.descriptors[looked.existence > 0.5])


def test_questions_by_name_and_by_vector_are_both_answered(reported: Path, tmp_path: Path) -> None:
    own, looked = read_record(reported / "belief"), alone(tmp_path, "embedding")
    chairs, cups = (find_objects(own.beliefs[-1], Question(name=label)).objects[0] for label in LABELS)
    assert chairs.object_id != cups.object_id and min(chairs.probability, cups.probability) > 0.7
    asked = LOOKS + np.random.default_rng(2).normal(0.0, 0.3, LOOKS.shape)
    for vector in asked:
        answers = []
        for record in (own, looked):
            looks = appearances_of(record.beliefs, record.measurements, SETTINGS)
            answers.append(find_objects(record.beliefs[-1], Question(vector=vector), looks))
        (ours, *_), (theirs, *_) = (answer.objects for answer in answers)
        assert ours.object_id == theirs.object_id
        assert ours.probability == pytest.approx(theirs.probability, abs=1e-6) and ours.probability > 0.9


def test_the_next_run_takes_up_classes_and_looks_of_the_map(reported: Path, tmp_path: Path) -> None:
    prior = read_map_prior(reported / "objects.json")
    assert prior.descriptor_space == "embedding-128"
    assert {max(own.class_probabilities, key=own.class_probabilities.__getitem__) for own in prior.objects} == {*LABELS}
    settings = configured(tmp_path / "configuration", BOTH, association="enumerated")
    bag = write_bag(tmp_path / "bag", entries())
    done = run_bag(bag, tmp_path / "belief", load_configuration(settings), prior)
    assert done.fault is None
    last = read_record(tmp_path / "belief").beliefs[-1]
    assert last.association_entropy < 0.1
    assert last.class_probabilities.max(axis=1).min() > 0.8 and np.isfinite(last.descriptors).all()


@pytest.fixture(scope="module")
def fitted(reported: Path) -> Path:
    """The file that such a run teaches, by the command line."""
    path = reported.parent / "fitted.safetensors"
    with pytest.MonkeyPatch.context() as patch:
        assert call(patch, "fit", "--from-run", reported, "--out", path) == 0
    return path


def test_what_is_fitted_to_such_a_run_are_labels_and_vectors(
    reported: Path, fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The next run uses both; on the bag that they were fitted to, vectors have the models without it."""
    told = json.loads(fitted.with_suffix(".json").read_text())["vectors"]
    assert told["is_kept"] and told["held_out"]["after"]["log_evidence"] > told["held_out"]["before"]["log_evidence"]
    settings = replace(SETTINGS, path=str(fitted))
    labels, looks = load_label_model(settings), load_embedding_model(settings)
    assert labels is not None and labels.labels == read_labels(fitted).labels == LABELS
    assert looks is not None and looks.outlier_share == told["outlier_share"] < SETTINGS.outlier_share
    others = looking(place_entries("ranges", FRAMES + 1), looks=LOOKS[::-1])
    for name, entries_of_bag, model in (("own", entries(), embedding_model(SETTINGS)), ("other", others, looks)):
        folder = tmp_path / name
        configuration = load_configuration(configured(folder / "configuration", BOTH | {"path": str(fitted)}))
        run_bag(write_bag(folder / "bag", entries_of_bag), folder / "belief", configuration)
        said = "its vectors have the models that were fitted without this bag" in capsys.readouterr().out
        assert said == (name == "own")
        used = load_embedding_model(settings, sha256_of(folder / "belief"))
        assert used is not None and used.outlier_share == model.outlier_share


def sha256_of(belief: Path) -> str:
    return read_record(belief).run.source_sha256


def test_the_parts_of_such_a_file_serve_runs_by_labels_and_runs_by_vectors(fitted: Path, tmp_path: Path) -> None:
    labels = load_label_model(replace(SETTINGS, kind="detector", path=str(fitted)))
    looks = load_embedding_model(SemanticModelConfiguration(kind="embedding", path=str(fitted)))
    both = replace(SETTINGS, path=str(fitted))
    own = load_label_model(both)
    assert labels is not None and own is not None and looks == load_embedding_model(both)
    np.testing.assert_array_equal(labels.class_shares, own.class_shares)
    assert looks != embedding_model(SETTINGS)
    without = tmp_path / "labels.safetensors"
    save_labels(replace(read_labels(fitted), vectors=None), without)
    assert load_embedding_model(replace(both, path=str(without))) == embedding_model(SETTINGS)
    with pytest.raises(InputError, match="was fitted to labels alone"):
        load_embedding_model(SemanticModelConfiguration(kind="embedding", path=str(without)))


def test_runs_of_both_kinds_without_a_vector_teach_labels_alone_and_the_command_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mute = place_entries("ranges", FRAMES)
    for entry in of_topic(mute, topics.DETECTIONS):
        entry.message = to_message(replace(from_message(entry.message), labels=LABELS))
    settings = load_configuration(configured(tmp_path / "configuration", BOTH))
    run_bag(write_bag(tmp_path / "bag", mute), tmp_path / "out" / "belief", settings)
    path = tmp_path / "fitted.safetensors"
    assert call(monkeypatch, "fit", "--from-run", tmp_path / "out", "--out", path) == 0
    assert "vectors: no object of the runs has one, so their models are as configured" in capsys.readouterr().out
    assert read_labels(path).vectors is None


def test_a_file_of_vectors_gives_the_vectors_models_and_labels_keep_theirs(tmp_path: Path) -> None:
    model, path = embedding_model(SETTINGS), tmp_path / "looks.safetensors"
    counts = tuple(np.linspace(0.1, 2.0, len(model.within)).tolist())
    fitted = FittedEmbeddings(
        dimensions=model.dimensions,
        spread_shares=model.spread_shares,
        noise_shares=model.noise_shares,
        whole=LooksByDirection(repeat_rad=1.4, counts=counts),
        without={},
        report={},
    )
    save_embeddings(fitted, path)
    settings = replace(SETTINGS, path=str(path))
    found, labels = load_embedding_model(settings), load_label_model(settings)
    assert found is not None and (found.repeat_rad, found.shared_counts) == (1.4, counts)
    assert fitted_labels(settings) is None and labels is not None
    np.testing.assert_array_equal(labels.class_shares, np.full(3, 1.0 / 3.0))
    with pytest.raises(InputError, match=r"holds kind 'embedding'.*wanted is 'detector'"):
        load_label_model(replace(settings, kind="detector"))
    path.write_text("something else")
    with pytest.raises(InputError, match="not readable as safetensors"):
        load_label_model(settings)


def test_labels_that_nobody_lists_and_no_detection_has_are_an_error_with_a_remedy(tmp_path: Path) -> None:
    found = looking(place_entries("ranges"))
    for entry in of_topic(found, topics.DETECTIONS):
        told = from_message(entry.message)
        entry.message = to_message(replace(told, labels=("",) * len(told)))
    settings = load_configuration(configured(tmp_path / "configuration", BOTH))
    with pytest.raises(InputError, match=r"detector_embedding, but nothing tells.*semantic_model.kind: embedding"):
        done = run_bag(write_bag(tmp_path / "bag", found), tmp_path / "belief", settings)
        if done.fault is not None:
            raise done.fault

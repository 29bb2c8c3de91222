"""Questions to a map: by class, by text, in a region; what cannot be answered is one line with a remedy."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from safetensors.numpy import save_file
from semantic_slam_lab.studies.embeddings.known_map import map_of

from semantic_slam.answers.appearances import Appearances, SeenView
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.question import Question
from semantic_slam.answers.text_vectors import read_text_vectors, read_vector
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces

SIZE, COUNT = 256, 8
RANDOM = np.random.default_rng(0)
LOOKS = RANDOM.normal(size=(COUNT, SIZE))
NAMES = [f"thing {number}" for number in range(COUNT + 4)]


def looks() -> Appearances:
    random = np.random.default_rng(1)
    views = [
        SeenView(object_id=n, vector=LOOKS[n] + random.normal(0, 0.4, SIZE), place=CameraPlaces.one(a, 0.0))
        for n in range(COUNT)
        for a in np.linspace(-np.pi, np.pi, 6, endpoint=False)
    ]
    return Appearances.of(views, np.zeros((0, SIZE)), SemanticModelConfiguration())


def texts() -> dict[str, np.ndarray]:
    """In a cone of their own, which has nothing to do with pictures, a little towards what they name."""
    random = np.random.default_rng(2)
    meant = np.vstack([LOOKS, random.normal(size=(4, SIZE))])
    cone = 3.0 * random.normal(size=SIZE)
    return {name: cone + own + random.normal(size=SIZE) for name, own in zip(NAMES, meant, strict=True)}


def classified(weights, chairs, existence):
    """Chairs and cups: (H,) ``weights`` and (H, O) probabilities of a chair, and (O,) of existence."""
    classes = np.stack([chairs, 1.0 - chairs], axis=2)
    return replace(
        map_of(chairs.shape[1]),
        class_names=("chair", "cup"),
        log_weights=np.log(weights),
        hypothesis_class_probabilities=classes,
        class_probabilities=np.einsum("h,hoc->oc", weights, classes),
        existence=existence,
    )


def test_a_class_is_found_as_probably_as_it_exists_and_is_of_that_class():
    known = classified(np.ones(1), np.array([[0.9, 0.2]]), np.array([0.5, 1.0]))
    found = find_objects(known, Question(name="chair"))
    assert [(own.object_id, own.probability) for own in found.objects] == [(0, pytest.approx(0.45)), (1, 0.2)]
    assert found.unknown == pytest.approx(0.55 * 0.8)


def test_no_object_is_of_a_class_with_the_probability_over_all_hypotheses_and_classes():
    """By enumeration: under each hypothesis every object may be there or not, and a chair or a cup."""
    weights, chairs = np.array([0.6, 0.3, 0.1]), np.array([[0.95, 0.05, 0.1], [0.05, 0.9, 0.1], [0.4, 0.4, 0.2]])
    existence = np.array([1.0, 0.9, 0.5])
    none = 0.0
    for weight, of_chair in zip(weights, chairs, strict=True):
        for there, chair in product(product((True, False), repeat=3), repeat=2):
            if not any(np.logical_and(there, chair)):
                none += (
                    weight
                    * np.prod(np.where(there, existence, 1.0 - existence))
                    * np.prod(np.where(chair, of_chair, 1.0 - of_chair))
                )
    found = find_objects(classified(weights, chairs, existence), Question(name="chair"))
    assert found.unknown == pytest.approx(none)
    known = {own.object_id: own.probability for own in found.objects}
    assert [known[n] for n in range(3)] == pytest.approx(list(existence * (weights @ chairs)))


def test_a_chair_that_is_one_object_or_the_other_is_surely_there_and_one_object_is_unknown_as_it_is_improbable():
    sure = classified(np.array([0.681, 0.319]), np.array([[1.0, 0.0], [0.0, 1.0]]), np.ones(2))
    assert find_objects(sure, Question(name="chair")).unknown == pytest.approx(0.0, abs=1e-12)
    doubted = classified(np.array([0.4, 0.6]), np.array([[1.0], [0.3]]), np.array([0.5]))
    found = find_objects(doubted, Question(name="chair", region=(0.0, -1.0, 1.0, 1.0)))  # half of its place
    assert found.objects[0].probability == pytest.approx(0.58 / 4, abs=1e-3)
    assert found.unknown == pytest.approx(1.0 - found.objects[0].probability)


def test_an_object_at_the_edge_of_a_region_lies_in_it_by_half():
    classes = {"class_probabilities": np.ones((1, 1)), "hypothesis_class_probabilities": np.ones((1, 1, 1))}
    known = replace(map_of(1), class_names=("cup",), **classes)
    found = find_objects(known, Question(name="cup", region=(0.0, -1.0, 1.0, 1.0)))
    assert found.objects[0].probability == pytest.approx(0.5, abs=1e-3)
    assert found.unknown == pytest.approx(0.5, abs=1e-3)


def test_a_view_shows_one_thing_and_what_hardly_exists_is_hardly_found():
    appearances, known = looks(), map_of(COUNT)
    found = find_objects(known, Question(vector=LOOKS[3]), appearances)
    assert found.objects[0].object_id == 3 and found.objects[0].probability > 0.99
    assert sum(own.probability for own in found.objects) + found.unknown == pytest.approx(1.0)
    elsewhere = find_objects(known, Question(vector=LOOKS[3], region=(90.0, 90.0, 99.0, 99.0)), appearances)
    assert elsewhere.unknown == pytest.approx(1.0, abs=1e-6)
    doubted = replace(known, existence=np.where(np.arange(COUNT) == 3, 0.1, 1.0))
    assert find_objects(doubted, Question(vector=LOOKS[3]), appearances).objects[0].probability <= 0.1


def test_a_text_finds_what_it_names_wherever_texts_lie():
    appearances, known = looks(), map_of(COUNT)
    best = [find_objects(known, Question(name=name, text_vectors=texts()), appearances).objects[0] for name in NAMES]
    assert [own.object_id for own in best[:COUNT]] == list(range(COUNT))
    assert np.mean([own.probability for own in best[:COUNT]]) > 0.8
    assert max(own.probability for own in best[COUNT:]) < 0.2


@pytest.mark.parametrize(
    ("question", "fault"),
    [
        (lambda: Question(), "nothing is looked for"),
        (lambda: Question(name="cup", vector=LOOKS[0]), "at once"),
        (lambda: Question(name="cup", text_vectors={"tv": LOOKS[0]}), "no text vector is named 'cup'"),
        (lambda: Question(name="cup", region=(1.0, 0.0, 0.0, 1.0)), "region must be"),
        (lambda: Question(name="cup", region=(0.0, 1.0, 1.0)), "region must be x_min y_min x_max y_max"),
        (lambda: Question(name="cup", region="abcd"), "region must be x_min y_min x_max y_max"),
        (lambda: Question(name="cup", least_probability=None), "least probability must lie between 0 and 1"),
        (lambda: Question(vector=np.array([np.nan])), "one row of finite numbers; give what the network gave"),
        (lambda: Question(name="cup", text_vectors={"cup": LOOKS}), "one row of finite numbers"),
        (lambda: find_objects(map_of(1), Question(name="cup")), "no class of the map"),
        (lambda: find_objects(map_of(1), Question(vector=LOOKS[0])), "nothing is known of what the objects look like"),
        (lambda: find_objects(map_of(COUNT), Question(vector=LOOKS[0, :9]), looks()), "9 components.*have 256"),
        (lambda: find_objects(map_of(COUNT), Question(vector=0 * LOOKS[0]), looks()), "no direction"),
        (
            lambda: find_objects(map_of(COUNT), Question(name="a", text_vectors={"a": LOOKS[0]}), looks()),
            "give 3 at least",
        ),
    ],
)
def test_what_cannot_be_answered_is_said(question, fault):
    with pytest.raises(InputError, match=fault):
        question()


def test_named_vectors_are_read_from_files_that_are_data_alone(tmp_path):
    named = {"cup": np.arange(3.0), "tv": np.ones(3)}
    np.savez(tmp_path / "a.npz", **named)
    save_file(named, str(tmp_path / "a.safetensors"))
    (tmp_path / "a.json").write_text(json.dumps({name: own.tolist() for name, own in named.items()}))
    for ending in ("npz", "safetensors", "json"):
        found = read_text_vectors(tmp_path / f"a.{ending}")
        assert found.keys() == named.keys()
        np.testing.assert_array_equal(found["cup"], named["cup"])
    np.save(tmp_path / "v.npy", named["cup"])
    np.testing.assert_array_equal(read_vector(tmp_path / "v.npy"), named["cup"])


def test_files_that_hold_something_else_are_refused(tmp_path):
    np.savez(tmp_path / "pickled.npz", cup=np.array([{"a": 1}], dtype=object))
    (tmp_path / "list.json").write_text("[[1], 2]")
    (tmp_path / "text.json").write_text('{"cup": "tea"}')
    (tmp_path / "broken.safetensors").write_bytes(b"nothing")
    np.savez(tmp_path / "lengths.npz", cup=np.ones(2), tv=np.ones(3))
    for path in (*tmp_path.iterdir(), tmp_path / "missing.npz", tmp_path / "a.pkl"):
        with pytest.raises(InputError, match=path.name):
            read_text_vectors(path)

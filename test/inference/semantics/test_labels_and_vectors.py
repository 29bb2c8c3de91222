"""Labels and vectors of a detection are two measurements of one object: their evidence adds up."""

from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from semantic_slam import Configuration, Engine, HybridBelief, Keyframe, MapPrior
from semantic_slam.contracts.semantics import Weighed
from semantic_slam.inference.building import initial_pose_of, make_run_configuration, problem_of
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.semantics.detector.detector_labels import DetectorLabels
from semantic_slam.inference.semantics.embeddings.embedding_views import EmbeddingViews
from semantic_slam.inference.semantics.interface import RanksPairs, SemanticEvidence, SemanticInput
from semantic_slam.inference.semantics.labels_and_vectors import LabelsAndVectors
from semantic_slam.inference.world.map_prior import ObjectPrior
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground, SeenVectors
from semantic_slam.viewpoint.embeddings.vectors import reduced

LABELS = ("chair", "cup")
LOOKS = np.random.default_rng(3).normal(size=(2, 32))
THINGS = (("chair", 0), ("chair", 1), ("cup", 1))
"""Label and look of three things: labels do not tell the first two apart, looks not the last two."""
PLACES = np.array([[3.0, -1.0], [3.0, 1.0], [4.0, 0.0]])
KINDS = ("none", "detector", "embedding", "detector_embedding")


def seen(thing: int, random: np.random.Generator, x: float, y: float, **others: Any) -> Detection:
    """A detection of a thing at (x, y) [m] before the robot."""
    label, look = THINGS[thing]
    vector = LOOKS[look] + random.normal(0.0, 0.3, LOOKS.shape[1])
    return Detection.at(x, y, label=label, track_id=str(thing), embedding=vector, **others)


def drive(without_vectors: tuple[int, ...] = ()) -> list[Keyframe]:
    """Past the three things; the detections of some keyframes carry no vectors."""
    random, found = np.random.default_rng(0), []
    for k in range(5):
        there = PLACES - [0.3 * k, 0.0]
        detections = [seen(thing, random, *there[thing]) for thing in range(3) if (k + thing) % 4]
        if k in without_vectors:
            detections = [replace(own, embedding=()) for own in detections]
        found.append(Keyframe.planar(k, motion=(0.3 if k else 0.0, 0.0, 0.0), detections=detections))
    return found


def driven(kind: str, keyframes: list[Keyframe], association: str = "given") -> tuple[Engine, list[HybridBelief]]:
    model = {"kind": kind, **({"labels": LABELS} if "detector" in kind else {})}
    engine = Engine(Configuration.of(association=association, semantic_model=model))
    return engine, [engine.process(keyframe) for keyframe in keyframes]


class BesideBoth(LabelsAndVectors):
    """Keeps what labels and vectors say alone of each keyframe, beside what they say together."""

    def __init__(self, labels: DetectorLabels, vectors: EmbeddingViews) -> None:
        super().__init__(labels, vectors)
        self.alone, self.both = (labels, vectors), LabelsAndVectors(labels, vectors)
        self.asked: list[tuple[Weighed, Weighed, Weighed]] = []

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        parts = [Weighed.by(own, given) for own in (*self.alone, self.both)]
        self.asked.append((parts[0], parts[1], parts[2]))
        return parts[2].evidence


@pytest.fixture(scope="module")
def asked() -> list[tuple[Weighed, Weighed, Weighed]]:
    """Of each keyframe of an open world: what labels, vectors and both say of every candidate."""
    own = Configuration.of(association="open", semantic_model={"kind": "detector_embedding", "labels": LABELS})
    run = make_run_configuration(own, None, *initial_pose_of(own), stamp_ns=0)
    problem = problem_of(run)
    assert isinstance(problem.semantics, LabelsAndVectors)
    both = BesideBoth(problem.semantics._labels, problem.semantics._vectors)
    watched = replace(problem, semantics=both)
    engine = Engine.of_run(run, InProcessPool(1, watched), watched)
    for keyframe in drive(without_vectors=(2,)):
        engine.process(keyframe)
    return both.asked


def test_the_evidence_of_both_is_the_sum_of_what_labels_and_vectors_say(
    asked: list[tuple[Weighed, Weighed, Weighed]],
) -> None:
    for labels, vectors, both in asked:
        expected = labels.evidence.log_weights + vectors.evidence.log_weights
        np.testing.assert_array_equal(both.evidence.log_weights, expected)
    last = asked[-1]
    assert min(np.ptp(own.evidence.log_weights) for own in last) > 0.5


def test_a_record_has_the_words_of_one_part_and_the_appearance_of_the_other(
    asked: list[tuple[Weighed, Weighed, Weighed]],
) -> None:
    for labels, vectors, both in asked:
        parents = both.given.candidates.assignments.parents
        rows = zip(labels.records, vectors.records, both.records, parents, strict=True)
        for named, looked, found, parent in rows:
            assert found.keys() == named.keys() >= looked.keys()
            for number, record in found.items():
                np.testing.assert_array_equal(record.log_likelihood, named[number].log_likelihood)
                if number in looked:
                    pair = [own for own in (record.appearance, looked[number].appearance) if own is not None]
                    ours, theirs = (own.mean_direction(np.zeros(len(own.log_settings)))[0] for own in pair)
                    np.testing.assert_array_equal(ours, theirs)
                else:
                    before = both.given.parents[parent].views.get(number)
                    assert record.appearance is (None if before is None else before.appearance)
    assert any(set(both.records[0]) - set(vectors.records[0]) for _, vectors, both in asked)


def test_where_identities_are_given_what_either_part_says_is_what_it_says_alone() -> None:
    """Evidence of the drive, classes as with labels alone, appearances as with vectors alone."""
    found = {kind: driven(kind, drive()) for kind in KINDS}
    log_evidence = {kind: engine.log_evidence for kind, (engine, _) in found.items()}
    (none, detector, embedding, both), last = log_evidence.values(), {kind: own[-1] for kind, (_, own) in found.items()}
    assert both - none == pytest.approx((detector - none) + (embedding - none), abs=1e-9)
    assert abs(detector - none) > 1.0 and abs(embedding - none) > 1.0
    of_both = last["detector_embedding"]
    np.testing.assert_array_equal(of_both.class_probabilities, last["detector"].class_probabilities)
    assert of_both.class_names == last["detector"].class_names
    np.testing.assert_array_equal(of_both.descriptors, last["embedding"].descriptors)
    np.testing.assert_array_equal(of_both.descriptor_covariances, last["embedding"].descriptor_covariances)
    assert np.isfinite(of_both.descriptors).all()


def test_an_object_whose_detections_carried_no_vector_has_a_class_and_no_appearance() -> None:
    _, beliefs = driven("detector_embedding", drive(without_vectors=(0, 1, 2, 3, 4)))
    assert np.isnan(beliefs[-1].descriptors).all()
    assert beliefs[-1].class_probabilities[:, :2].max(axis=1).min() > 0.6


def map_at_one_place() -> MapPrior:
    """Three things at the same place, so that only labels and vectors tell them apart; what they look like is known."""
    size, names = LOOKS.shape[1], (*LABELS, "none of these")
    unit = reduced(LOOKS, size)
    classes = {"chair": (0.8, 0.15, 0.05), "cup": (0.1, 0.85, 0.05)}
    return MapPrior(
        tuple(
            replace(
                ObjectPrior.planar(number, 3.0, 0.0, sigma_m=0.2, sigma_rad=0.2),
                class_probabilities=dict(zip(names, classes[label], strict=True)),
                descriptor=unit[look],
                descriptor_variance=np.full(size, SPREAD / size),
            )
            for number, (label, look) in enumerate(THINGS)
        ),
        f"embedding-{size}",
    )


SPREAD, WITHIN, NOISE, OUTLIERS = 0.02, 0.1, 0.04, 0.05


def by_enumeration(kind: str, detections: list[Detection]) -> dict[tuple[int, ...], float]:
    """Probability of each of the six assignments of three detections: a product of words and of vectors, normalised."""
    size = LOOKS.shape[1]
    vectors = reduced(np.array([own.embedding for own in detections]), size)
    background = SeenVectors.none(size).with_vectors(vectors).background
    weights = {}
    for row in permutations(range(3)):
        known = [map_at_one_place().objects[thing] for thing in row]
        words, looks = np.ones(2), 1.0  # words under either setting of the detector, which is one for all
        for detection, vector, own in zip(detections, vectors, known, strict=True):
            words *= word_probabilities(detection.label, np.array(list(own.class_probabilities.values())))
            looks *= look_ratio(vector, own.descriptor, background)
        weights[row] = (words.mean() if "detector" in kind else 1.0) * (looks if "embedding" in kind else 1.0)
    return {row: own / sum(weights.values()) for row, own in weights.items()}


def word_probabilities(word: str, classes: np.ndarray) -> np.ndarray:
    """(2,) P(word) of the first view of an object by words alone, and by a score of 1, of which 0.98 are believed.

    ``classes`` (3,): the map's probabilities of chair, cup and neither, of which 0.99 are believed.
    """
    count, accuracy = 3, 0.75
    called = np.full((count, count), (1.0 - accuracy) / (count - 1))
    np.fill_diagonal(called, accuracy)
    called[-1] = 0.5 * (called[-1] + 1.0 / count)  # neither: by the other word, or by any
    one = np.eye(count)[LABELS.index(word)]
    scores = (one + 0.01 * (1.0 - one)) / 1.02
    told = np.array([called @ one, called @ scores])
    return np.asarray(((1.0 - OUTLIERS) * told + OUTLIERS / count) @ (0.99 * classes + 0.01 / count))


def look_ratio(vector: np.ndarray, mean: np.ndarray, background: EmbeddingBackground) -> float:
    """Density of the first view of an object that a map knows, relative to the background's."""
    within = WITHIN + NOISE
    share = within + min(1.0 - within, SPREAD / background.spread)
    off, aside = vector - mean, vector - background.centre
    scaled = (off @ off / share - aside @ aside) / background.spread
    ratio = float(np.exp(-0.5 * background.dimensions * (scaled + np.log(share))))
    return (1.0 - OUTLIERS) * ratio + OUTLIERS


@pytest.mark.parametrize("kind", KINDS[1:])
def test_assignments_to_three_things_at_one_place_are_as_probable_as_by_enumeration(kind: str) -> None:
    random = np.random.default_rng(1)
    order = (2, 0, 1)
    detections = [seen(thing, random, 3.0, 0.0) for thing in order]
    model = {
        "kind": kind,
        "embedding_dimensions": LOOKS.shape[1],
        "spread_shares": (WITHIN,),
        "noise_shares": (NOISE,),
        "outlier_share": OUTLIERS,
        **({"labels": LABELS} if "detector" in kind else {}),
    }
    prior = map_at_one_place()
    if kind == "detector":
        prior = replace(prior, objects=tuple(replace(own, descriptor=np.zeros(0)) for own in prior.objects))
    if kind == "embedding":
        prior = replace(prior, objects=tuple(replace(own, class_probabilities={}) for own in prior.objects))
    configuration = Configuration.of(
        association="enumerated",
        semantic_model=model,
        pruning={"ratio": 1e12},
        closed_world={"displaced_share": 0.0, "clutter_per_frame": 0.0},
    )
    belief = Engine(configuration, prior).process(Keyframe.planar(0, detections=detections))
    found = dict.fromkeys(permutations(range(3)), 0.0)
    for row, weight in zip(belief.associations.tolist(), np.exp(belief.log_weights).tolist(), strict=True):
        found[tuple(row)] += weight
    exact = by_enumeration(kind, detections)
    assert found == pytest.approx(exact, abs=1e-6)
    best = max(exact.values())
    if kind == "detector_embedding":
        assert exact[order] == best > 0.6
    else:
        assert best < 0.51


CROWDED = np.array([[3.0, -0.3], [3.0, 0.3], [3.4, 0.0]])
CROWDED_SIGMA_M = 0.6
"""Places closer together than they are measured."""


def test_what_has_the_label_of_one_and_the_look_of_another_is_known_again_by_both_alone() -> None:
    """In an open world: seen twice, and once more in another order."""
    right = {}
    for kind in KINDS[1:]:
        random = np.random.default_rng(5)
        frames = [
            [seen(thing, random, *CROWDED[thing], covariance=CROWDED_SIGMA_M**2 * np.eye(2)) for thing in order]
            for order in ((0, 1, 2), (0, 1, 2), (1, 2, 0))
        ]
        _, beliefs = driven(kind, [Keyframe.planar(k, detections=own) for k, own in enumerate(frames)], "open")
        (first,), last = beliefs[0].associations, beliefs[-1]
        is_right = (last.associations == first[[1, 2, 0]]).all(axis=1)
        right[kind] = float(np.exp(last.log_weights)[is_right].sum())
    assert right["detector_embedding"] > 0.9
    assert max(right["detector"], right["embedding"]) < 0.6


@pytest.mark.parametrize("kind", ["detector", "detector_embedding"])
def test_two_objects_of_one_label_may_be_one_and_two_of_different_labels_hardly(kind: str) -> None:
    engine, _ = driven(kind, drive())
    ((number, _),) = engine.live.items()
    views, semantics = engine.pool._backends[0].held[number].component.views, engine.problem.semantics
    assert isinstance(semantics, RanksPairs)
    chair, other, cup = sorted(views.values(), key=lambda own: int(own.log_likelihood.argmax()))
    log_prior = engine.registry.log_class_prior_of(sorted(views)[:1])[0]
    assert semantics.log_of_one(chair, other, log_prior) > 0.5
    assert semantics.log_of_one(chair, cup, log_prior) < -0.5
    assert semantics.log_of_one(chair, cup, log_prior) == pytest.approx(semantics.log_of_one(cup, chair, log_prior))

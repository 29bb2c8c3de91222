"""What a run knew of classes before it saw an object is not a second witness where maps are merged or compared."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.scenes.small_map import LOOSE

from semantic_slam.configuration import Configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.inference.world.roots import closed_root
from semantic_slam.maps.as_prior import map_prior_of, saved_map_of_prior
from semantic_slam.maps.class_priors import class_evidence, class_priors_of
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.from_run import saved_map_of_engine
from semantic_slam.maps.map_file import FORMAT, packed, read_map, with_id, write_map
from semantic_slam.maps.merging import merged
from semantic_slam.maps.saved_map import SavedMap
from semantic_slam.model_files import ModelFormat

PLACES = {"a": (3.0, -2.0), "b": (3.0, 2.0), "c": (4.0, -1.0), "d": (4.5, 1.0), "e": (5.0, 0.0), "odd": (3.0, 0.0)}
CONFIGURATION = Configuration.of(
    association="given", semantic_model={"kind": "detector", "labels": ["chair", "cup"], "class_counts": 0.2}
)


def furnished(turns: int, prior: MapPrior | None = None) -> SavedMap:
    """The map of five chairs, and of something that is once called a cup, by a detector that is hardly sure."""
    engine = Engine(CONFIGURATION, prior)
    for index in range(turns):
        names = [name for name in PLACES if name != "odd" or index == turns - 1]
        seen = [
            Detection.at(*PLACES[name], label="cup" if name == "odd" else "chair", track_id=name, score=0.5)
            for name in names
        ]
        belief = engine.process(Keyframe.planar(index, detections=seen))
    assert isinstance(engine.pool, InProcessPool)
    return with_id(saved_map_of_engine(engine, engine.pool, belief))


@pytest.fixture(scope="module")
def room() -> SavedMap:
    return furnished(4)


def row_of(known: SavedMap, name: str) -> int:
    return known.objects.names.index(name)


def with_classes(known: SavedMap, probabilities: list[float], priors: list[float], name: str) -> SavedMap:
    """The map with other classes for one object."""
    objects, row = known.objects, row_of(known, name)
    told, before = objects.class_probabilities.copy(), objects.class_priors.copy()
    told[row], before[row] = probabilities, priors
    return with_id(replace(known, objects=replace(objects, class_probabilities=told, class_priors=before)))


def test_a_map_says_what_the_classes_of_the_others_told_of_each_object(room: SavedMap) -> None:
    priors = room.objects.class_priors
    np.testing.assert_allclose(priors.sum(axis=1), 1.0)
    np.testing.assert_allclose(priors[row_of(room, "a")], 1.0 / 3.0, atol=1e-9)
    odd = priors[row_of(room, "odd")]
    assert odd[0] > 0.5 > odd[1] + 0.2, "beside five things that are likely chairs"
    evidence = class_evidence(room.objects)[row_of(room, "odd")]
    assert evidence[1] > 0.5 > evidence[0], "it was called a cup, and nothing else"


def test_what_two_runs_learned_of_the_same_room_counts_once(room: SavedMap) -> None:
    """Nothing was seen of the object but that it is there: it is as likely a chair as any of the room's things."""
    told = with_classes(room, [0.9, 0.06, 0.04], [0.9, 0.06, 0.04], "odd")
    other = with_classes(furnished(5), [0.8, 0.1, 0.1], [0.8, 0.1, 0.1], "odd")
    both = merged(told, other, "", same_frame=True)
    row = row_of(both, "odd")
    np.testing.assert_allclose(both.objects.class_probabilities[row], [0.85, 0.08, 0.07], atol=1e-4)
    np.testing.assert_allclose(both.objects.class_priors[row], [0.85, 0.08, 0.07], atol=1e-12)


def test_what_was_seen_of_an_object_in_two_runs_is_independent(room: SavedMap) -> None:
    prior, one, two = np.array([0.7, 0.2, 0.1]), np.array([0.2, 0.7, 0.1]), np.array([0.3, 0.6, 0.1])
    told = [
        with_classes(own, (seen * prior / (seen @ prior)).tolist(), prior.tolist(), "odd")
        for own, seen in ((room, one), (furnished(5), two))
    ]
    both = merged(*told, "", same_frame=True)
    exact = prior * one * two
    np.testing.assert_allclose(both.objects.class_probabilities[row_of(both, "odd")], exact / exact.sum(), atol=1e-4)


def test_two_runs_from_one_map_do_not_count_its_classes_twice(room: SavedMap) -> None:
    """Both were told what it is, and saw nothing of it: what they say together is what they were told."""
    told, prior = np.array([0.9, 0.06, 0.04]), np.array([0.5, 0.3, 0.2])
    later = [with_classes(own, told.tolist(), prior.tolist(), "odd") for own in (room, furnished(5))]
    origin = [replace(own, provenance=replace(own.provenance, started_from="monday")) for own in later]
    both = merged(*map(with_id, origin), "", same_frame=True)
    np.testing.assert_allclose(both.objects.class_probabilities[row_of(both, "odd")], told, atol=1e-4)
    apart = merged(*later, "", same_frame=True).objects.class_probabilities[row_of(both, "odd")]
    np.testing.assert_allclose(apart, (told**2 / prior) / (told**2 / prior).sum(), atol=1e-4)


def test_two_runs_from_one_map_do_not_count_twice_that_a_thing_exists(room: SavedMap) -> None:
    """Both were told that it hardly does, and looked elsewhere; runs of their own that place it alike agree on it."""
    doubted = []
    for own in (room, furnished(5)):
        existence = own.objects.existence.copy()
        existence[row_of(own, "odd")] = 0.2
        doubted.append(with_id(replace(own, objects=replace(own.objects, existence=existence))))
    origin = [replace(own, provenance=replace(own.provenance, started_from="monday")) for own in doubted]
    both = merged(*map(with_id, origin), "", same_frame=True)
    assert both.objects.existence[row_of(both, "odd")] == pytest.approx(0.2, abs=1e-3)
    apart = merged(*doubted, "", same_frame=True)
    assert apart.objects.existence[row_of(apart, "odd")] > 0.8


def test_what_the_map_at_the_start_says_is_evidence_that_later_maps_hold(room: SavedMap) -> None:
    """Else what was known of an object on Sunday would be forgotten where Monday's map is merged with another."""
    first = with_classes(room, [0.02, 0.97, 0.01], [1.0 / 3.0] * 3, "odd")
    later = furnished(2, map_prior_of(first))
    row = row_of(later, "odd")
    assert later.objects.class_priors[row].max() < 0.34, "nothing is known of the room before"
    assert class_evidence(later.objects)[row, 1] > 0.9


def test_a_hypothesis_that_lacks_an_object_knows_no_more_of_it_than_that_it_is_new(room: SavedMap) -> None:
    """As in the probabilities that a belief states, of which the prior is taken out."""
    engine = Engine(CONFIGURATION)
    for index in range(3):
        seen = [Detection.at(*at, label="chair", track_id=name, score=0.5) for name, at in PLACES.items()]
        belief = engine.process(Keyframe.planar(index, detections=seen if index < 2 else seen[:1]))
    assert isinstance(engine.pool, InProcessPool)
    whole = [engine.pool.component(int(belief.hypothesis_ids[0])), closed_root(engine.problem)]
    arguments = np.array([5]), engine.registry.known, engine.problem.class_shares
    alone = class_priors_of(whole[:1], np.ones(1), *arguments)
    np.testing.assert_allclose(alone, 1.0 / 3.0)  # all came at once
    late = replace(whole[0].views[5], log_ratios=np.log([2.0, 0.5, 0.5]))
    known = replace(whole[0], views=whole[0].views | {5: late})
    both = class_priors_of([known, whole[1]], np.array([0.6, 0.2]), *arguments)
    np.testing.assert_allclose(both, [[0.75 * 2 / 3 + 0.25 / 3, 0.75 / 6 + 0.25 / 3, 0.75 / 6 + 0.25 / 3]])


def test_things_of_which_nothing_was_seen_are_not_alike_for_that(room: SavedMap) -> None:
    """Two maps in which most is a chair: that both say so of something tells nothing of which object it is."""
    told = with_classes(room, [0.9, 0.06, 0.04], [0.9, 0.06, 0.04], "odd")
    known = Comparison.of(told, with_id(replace(told, discarded_mass=0.5)), same_frame=True)
    (row,) = np.flatnonzero(known.ours.rows == row_of(told, "odd"))
    np.testing.assert_allclose(known.ours.classes[row], 1.0 / 3.0, atol=1e-4)


def test_a_map_of_the_schema_before_is_read_under_its_id(tmp_path: Path) -> None:
    old = with_id(saved_map_of_prior(LOOSE))
    assert old.map_id == "400c59e356f02e41", "as it was before class priors were told"
    arrays, description = packed(old)
    del arrays["objects.class_priors"]
    ModelFormat(kind=FORMAT.kind, schema_version=1, remedy="").write(tmp_path / "old.map", arrays, description)
    again = read_map(tmp_path / "old.map")
    assert again.map_id == old.map_id and np.isnan(again.objects.class_priors).all()
    written = write_map(tmp_path / "new.map", again)
    assert read_map(tmp_path / "new.map").map_id == written.map_id == old.map_id

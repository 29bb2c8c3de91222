"""Maps of two drives in which a detector showed different labels are merged over the labels of both."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.as_prior import saved_map_of_prior
from semantic_slam.maps.class_priors import class_evidence
from semantic_slam.maps.common_classes import over_common_classes
from semantic_slam.maps.map_file import read_map, with_id, write_map
from semantic_slam.maps.merging import merged
from semantic_slam.maps.saved_map import MapObjects, SavedMap
from semantic_slam.perception.class_names import NONE_OF_THESE

PLACES = ((3.0, -2.0), (3.0, 2.0), (5.0, 0.5))


def room(classes: list[dict[str, float]], first: int = 0) -> SavedMap:
    """Three objects of these classes."""
    told = zip(PLACES, classes, strict=True)
    items = [
        ObjectPrior.planar(first + n, *at, 0.0, sigma_m=0.05, sigma_rad=0.1, class_probabilities=own)
        for n, (at, own) in enumerate(told)
    ]
    return with_id(saved_map_of_prior(MapPrior(tuple(items))))


def monday() -> SavedMap:
    chair, cup = {"chair": 0.9, "cup": 0.04, NONE_OF_THESE: 0.06}, {"chair": 0.04, "cup": 0.9, NONE_OF_THESE: 0.06}
    return room([chair, cup, {"chair": 0.1, "cup": 0.1, NONE_OF_THESE: 0.8}])


def tuesday() -> SavedMap:
    """No cup was seen, and the third object was called a refrigerator."""
    chair = {"chair": 0.9, "refrigerator": 0.04, NONE_OF_THESE: 0.06}
    other = {"chair": 0.1, "refrigerator": 0.1, NONE_OF_THESE: 0.8}
    return room([chair, other, {"chair": 0.04, "refrigerator": 0.9, NONE_OF_THESE: 0.06}], first=20)


def test_a_label_that_one_drive_showed_and_the_other_did_not_is_on_the_merged_map(tmp_path: Path) -> None:
    both = merged(monday(), tuesday(), "", same_frame=True)
    assert both.class_names == ("chair", "cup", "refrigerator", NONE_OF_THESE)
    assert both.objects.ids.tolist() == [0, 1, 2]
    named = [both.class_names[best] for best in both.objects.class_probabilities.argmax(axis=1)]
    assert named == ["chair", "cup", "refrigerator"]
    written = write_map(tmp_path / "both.map", both)
    assert read_map(tmp_path / "both.map").map_id == written.map_id


def test_a_class_that_a_map_does_not_name_has_the_evidence_of_none_of_these() -> None:
    """Two witnesses of each class: 0.1 x 0.04 for a chair, 0.1 x 0.06 for a cup, ... by hand."""
    both = merged(monday(), tuesday(), "", same_frame=True)
    shares = both.objects.class_priors[2]
    np.testing.assert_allclose(shares, [1.0 / 3.0, 0.25, 0.25, 1.0 / 6.0])
    exact = np.array([0.1 * 0.04, 0.1 * 0.06, 0.8 * 0.9, 0.8 * 0.06]) * shares
    np.testing.assert_allclose(both.objects.class_probabilities[2], exact / exact.sum(), atol=1e-4)


def test_what_the_named_classes_have_stays_theirs() -> None:
    one, other = over_common_classes(monday(), tuesday())
    assert one.class_names == other.class_names
    np.testing.assert_allclose(one.objects.class_probabilities[0], [0.9, 0.04, 0.03, 0.03])
    np.testing.assert_allclose(one.hypotheses.class_probabilities[0, 0], [0.9, 0.04, 0.03, 0.03])
    np.testing.assert_allclose(other.objects.class_priors[0], [1.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0])
    evidence = class_evidence(one.objects)[0]
    assert evidence[2] == pytest.approx(evidence[3])


def test_classes_in_another_order_are_the_same_classes() -> None:
    one = monday()
    order = [2, 0, 1]
    objects = _in_order(replace(one.objects, ids=one.objects.ids + 20), order)
    hypotheses = replace(one.hypotheses, class_probabilities=one.hypotheses.class_probabilities[..., order])
    names = tuple(one.class_names[column] for column in order)
    other = with_id(replace(one, class_names=names, objects=objects, hypotheses=hypotheses))
    both = merged(one, other, "", same_frame=True)
    assert both.class_names == one.class_names
    assert both.objects.class_probabilities[1, 1] > 0.99


def test_class_models_of_different_classes_are_refused() -> None:
    """No class of theirs holds what the other run names."""
    desk = room([{"desk": 0.9, "crate": 0.1}] * 3)
    locker = room([{"desk": 0.9, "locker": 0.1}] * 3, first=20)
    with pytest.raises(InputError, match="the same class models"):
        merged(desk, locker, "", same_frame=True)


def _in_order(objects: MapObjects, order: list[int]) -> MapObjects:
    """The objects with the classes in another order."""
    return replace(
        objects,
        class_probabilities=objects.class_probabilities[:, order],
        class_priors=objects.class_priors[:, order],
    )

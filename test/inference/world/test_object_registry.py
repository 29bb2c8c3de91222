"""Which objects detections may begin, and what the detector called them then."""

import numpy as np

from semantic_slam.inference.world.objects import ObjectRegistry


def test_labels_are_those_of_the_detections_that_objects_began_with() -> None:
    registry = ObjectRegistry((), np.ones(1))
    told = [(), ("chair", "cup"), (), ("", ""), ("cup",)]
    for index, labels in enumerate(told):
        registry.reserve(index, len(labels), labels)
    registry.reserve(4, 1, ("sofa",))  # a keyframe that comes again
    assert [registry.first_new_id(index) for index in range(6)] == [0, 0, 2, 2, 4, 5]
    assert [registry.label_of(number) for number in range(-1, 7)] == ["", "chair", "cup", "", "", "cup", "", ""]


def test_a_label_is_held_once_however_often_it_comes() -> None:
    """A drive of days has millions of detections, of a few classes."""
    registry = ObjectRegistry((), np.ones(1))
    for index in range(2):
        registry.reserve(index, 1, ("".join(["ch", "air"]),))
    assert registry.label_of(0) is registry.label_of(1)

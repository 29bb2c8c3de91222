"""Vectors of appearance reach the engine from keyframes, whoever made these, and serve as features of fitted models."""

import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.inputs.planar_reader import PlanarReader
from semantic_slam.inference.inputs.vector_reader import VectorReader


def keyframe(index: int, *looks: list[float]) -> Keyframe:
    return Keyframe.planar(index, detections=[Detection(bearing_rad=0.0, range_m=1.0, embedding=own) for own in looks])


def test_a_detection_without_a_vector_has_none():
    told = VectorReader(2).vectors(keyframe(0, [3.0, 4.0], []))
    np.testing.assert_allclose(told.vectors, [[0.6, 0.8], [np.nan, np.nan]])


def test_the_background_is_of_all_keyframes_up_to_this_one_however_often_it_comes():
    reader = VectorReader(2)
    first = reader.vectors(keyframe(0, [1.0, 0.0]))
    second = reader.vectors(keyframe(1, [0.0, 1.0]))
    again = reader.vectors(keyframe(1, [0.0, 1.0]))
    assert second.background.centre[1] > first.background.centre[1] == 0.0
    np.testing.assert_array_equal(again.background.centre, second.background.centre)


@pytest.mark.parametrize("vectors", [([1.0, 2.0], [1.0]), ([[1.0]],), ([np.nan],)], ids=["lengths", "rows", "nan"])
def test_what_is_no_vector_is_refused(vectors):
    with pytest.raises(InputError, match="embedding"):
        keyframe(0, *vectors)


def test_class_models_that_were_fitted_on_vectors_get_them_as_features():
    detections = PlanarReader(3).step(keyframe(0, [1.0, 2.0, 3.0])).detections
    np.testing.assert_array_equal(detections[0].feature, [1.0, 2.0, 3.0])

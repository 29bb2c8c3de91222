"""What serves as the semantic feature where no classifier has measured one."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.inputs.score_features import FeatureReader
from semantic_slam.perception.measurement import SemanticMeasurements

READER = FeatureReader(2, ("cup", "box"))
COVARIANCES = np.full((1, 2, 2), 0.01) + 0.03 * np.eye(2)


def scored() -> SemanticMeasurements:
    detection = Detection(range_m=2.0, bearing_rad=0.1, class_scores={"box": 0.2, "cup": 0.7})
    return Keyframe.planar(0, detections=[detection]).measurements


def test_scores_are_features_without_covariance_in_the_order_of_the_models() -> None:
    told = READER.with_features(scored())
    np.testing.assert_array_equal(told.features, [[0.7, 0.2]])
    np.testing.assert_array_equal(told.feature_covariances, np.zeros((1, 2, 2)))


def test_covariances_beside_features_are_kept() -> None:
    given = replace(scored(), features=np.array([[0.7, 0.2]]), feature_covariances=COVARIANCES)
    assert READER.with_features(given) is given


@pytest.mark.parametrize("num_features", [0, 2])
def test_covariances_of_other_features_than_are_given_are_refused(num_features: int) -> None:
    """Of scores alone, too: it is not told which component is of which class."""
    covariances = COVARIANCES if not num_features else COVARIANCES[:, :1, :1]
    given = replace(scored(), features=np.full((1, num_features), 0.5), feature_covariances=covariances)
    with pytest.raises(InputError, match=f"not those of their {num_features} features; give one for each") as error:
        READER.with_features(given)
    assert "\n" not in str(error.value)


def test_models_without_features_read_nothing() -> None:
    given = replace(scored(), feature_covariances=COVARIANCES)
    assert FeatureReader().with_features(given) is given

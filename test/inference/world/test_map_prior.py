"""A map prior is checked where it is read: what is impossible is refused, what is rounded is accepted."""

import json
from typing import Any

import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior, parse_map_prior

COVARIANCE = np.diag([0.1, 0.1, 0.0, 0.0, 0.0, 0.2])


def parsed(frame: str = "map", **changes: Any) -> MapPrior:
    row = {"id": 1, "pose": [1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0], "covariance": COVARIANCE.tolist()} | changes
    return parse_map_prior(json.dumps({"frame": frame, "objects": [row]}), "objects.json")


def test_quaternion_is_normalised_once() -> None:
    prior = parsed(pose=[1.0, 2.0, 0.0, 0.0, 0.0, 3.0, 4.0])
    np.testing.assert_allclose(prior.objects[0].pose, [1.0, 2.0, 0.0, 0.0, 0.0, 0.6, 0.8])
    again = parse_map_prior(prior.to_json(), "again")
    np.testing.assert_array_equal(again.objects[0].pose, prior.objects[0].pose)


def test_rounded_covariance_is_accepted() -> None:
    assert parsed(covariance=(COVARIANCE + 1e-9 * np.eye(6, k=1)).ravel().tolist()).objects[0].covariance[0, 0] == 0.1


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"pose": [0.0] * 7}, "quaternion"),
        ({"pose": [0.0] * 6}, "7 finite numbers"),
        ({"covariance": (COVARIANCE + np.eye(6, k=1)).tolist()}, "symmetric"),
        ({"covariance": (COVARIANCE - 0.01 * np.eye(6)).tolist()}, "semi-definite"),
        ({"covariance": [1.0] * 35}, "36 finite numbers"),
        ({"covariance": np.diag([0.01] * 5 + [1e300]).tolist()}, "give 1e6 where nothing is known"),
        ({"id": -1}, "id -1"),
        ({"id": 2**32}, "id 4294967296"),
        ({"class_probabilities": {"chair": -0.1}}, "not negative"),
        ({"class_probabilities": {"chair": float("nan")}}, "finite"),
        ({"class_probabilities": {"chair": 0.0}}, "all zero"),
        ({"class_probabilities": [1.0]}, "not a map prior"),
        ({"frame": "odom"}, "'odom'"),
    ],
)
def test_impossible_object_is_refused(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=r"objects\.json: not a map prior") as caught:
        parsed(**changes)
    assert text in str(caught.value)


@pytest.mark.parametrize("text", ['{"objects": [{"id": 1, "frame": "odom"}]}', "[]", '{"objects": [3]}', "{"])
def test_other_documents_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"objects\.json: not a map prior"):
        parse_map_prior(text, "objects.json")

"""Vectors of appearance in space: what looks as before is what was there, however badly the camera's path is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from worlds.scenes.open_flights import Errors, OpenFlight

from semantic_slam import Detection
from semantic_slam.evaluation.history import best_history
from semantic_slam.inference.belief import HybridBelief

LOST = Errors((0.06, 0.06, 0.12, 0.2, 0.2, 0.2), 0.06, 0.3)
"""Errors with which places alone do not tell what is seen again."""
SIZE, NOISE = 64, 0.3


class FlightOfLooks(OpenFlight):
    """A flight among points that look different: a detection has the vector of its point, with noise."""

    def __init__(self, seed: int, **values: Any) -> None:
        self.looks = np.random.default_rng([seed, 3])
        self.vectors, self.shown = self.looks.normal(size=(12, SIZE)), list[list[int]]()
        super().__init__(seed, errors=LOST, **values)

    def _detections(self, clutter: float) -> list[Detection]:
        self.shown.append([])
        return super()._detections(clutter)

    def _detection(self, away: np.ndarray, n: int) -> Detection:
        self.shown[-1].append(n)
        vector = self.vectors[n] + NOISE * self.looks.normal(size=SIZE)
        return replace(super()._detection(away, n), embedding=vector)

    def share_of_pairs(self, beliefs: list[HybridBelief]) -> float:
        """F1 of pairs of detections that the best history has of one object."""
        own = np.concatenate([ids for ids in best_history(beliefs) if ids is not None])
        true = np.concatenate(self.shown)
        first, second = np.triu_indices(len(own), 1)
        stated = (own[first] == own[second]) & (own[first] >= 0)
        alike = true[first] == true[second]
        return float(2.0 * (stated & alike).sum() / (stated.sum() + alike.sum()))


KINDS = ({"kind": "embedding"}, {"kind": "detector_embedding", "labels": ("post", "door")})


@pytest.mark.long
@pytest.mark.parametrize("model", KINDS, ids=lambda model: model["kind"])
def test_looks_tell_what_is_seen_again_where_places_do_not(model: dict[str, Any]) -> None:
    """Objects come with the mean directions of their vectors, and where there are labels, with their classes."""
    found = {}
    for kind, own in (("none", {"kind": "none"}), ("embedding", model)):
        flight = FlightOfLooks(3, semantic_model=own, labels=model.get("labels", ()))
        beliefs = list(flight.beliefs(16))
        found[kind] = flight.share_of_pairs(beliefs)
    assert found["none"] < 0.9 and found["embedding"] > 0.97
    last = beliefs[-1]
    there = last.existence > 0.5
    assert there.sum() == len(flight.seen)
    alike = np.corrcoef(last.descriptors[there][:, :SIZE], flight.vectors)[: there.sum(), there.sum() :]
    shown = alike.argmax(axis=1)
    assert sorted(shown.tolist()) == sorted(flight.seen)
    if model.get("labels"):
        assert last.class_names[:2] == model["labels"]
        assert last.class_probabilities[there].argmax(axis=1).tolist() == (shown % 2).tolist()


@pytest.mark.parametrize("model", KINDS, ids=lambda model: model["kind"])
def test_rays_have_looks_too(model: dict[str, Any]) -> None:
    """Half of the detections without a range, of which the distance is vague at first."""
    flight = FlightOfLooks(3, semantic_model=model, labels=model.get("labels", ()))
    assert flight.share_of_pairs(list(flight.beliefs(16, rays=0.5))) > 0.97


@pytest.mark.long
def test_upright_bodies_may_have_looks() -> None:
    """Their attitudes do not matter: the objects are those of points."""
    flights = [
        FlightOfLooks(1, observation=observation, semantic_model={"kind": "embedding"})
        for observation in ("points", "range_bearing")
    ]
    for of_points, own in zip(*(flight.beliefs(8) for flight in flights), strict=True):
        np.testing.assert_allclose(own.existence, of_points.existence, atol=1e-3)
        there = own.existence > 0.5
        np.testing.assert_allclose(own.descriptors[there], of_points.descriptors[there], atol=5e-3)

"""Vectors of long ago are reassigned: the gain is the ratio of the Gaussians that they are drawn from."""

from collections.abc import Mapping

import numpy as np
import pytest

from semantic_slam.inference.semantics.embeddings.appearance_views import AppearanceView, record_of_views
from semantic_slam.inference.semantics.embeddings.reassigned_vectors import reassigned_vectors
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground
from semantic_slam.viewpoint.embeddings.camera_places import CameraPlaces
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel

SIZE, SPREAD, NOISE, REACH = 12, 0.3, 0.05, 0.8
BACKGROUND = EmbeddingBackground(centre=np.zeros(SIZE), spread=1.0, dimensions=float(SIZE))
AZIMUTHS = np.linspace(-2.5, 2.5, 8)
VECTORS = np.random.default_rng(2).normal(0.0, SIZE**-0.5, (8, SIZE))
OWNERS = (3, 3, 7, 7, 3, 7, 7, 5)
"""Objects of one detection in each keyframe."""


def model(spreads: tuple[float, ...] = (SPREAD,), noises: tuple[float, ...] = (NOISE,)) -> EmbeddingModel:
    return EmbeddingModel(
        dimensions=SIZE, spread_shares=spreads, noise_shares=noises, repeat_rad=REACH, outlier_share=0.0
    )


def views(own: EmbeddingModel) -> dict[int, ObjectViews]:
    """The records of all objects, each weighed as if there were no other."""
    found = dict[int, ObjectViews]()
    for keyframe, (number, azimuth, vector) in enumerate(zip(OWNERS, AZIMUTHS.tolist(), VECTORS, strict=True)):
        place, before = CameraPlaces.one(azimuth, 0.0), found.get(number)
        record = own.start() if before is None or before.appearance is None else before.appearance
        ratios = record.log_ratios(vector, BACKGROUND, place)[:, 0]
        usual = own.usual(np.zeros(len(own.within)))
        view = AppearanceView(detection=(keyframe, 0), vector=vector, background=BACKGROUND, place=place)
        seen = (view,) if before is None else (*before.appearance_views, view)
        found[number] = record_of_views(record.after(vector, ratios, usual, BACKGROUND, place), seen)
    return found


def exact(owners: tuple[int, ...]) -> float:
    """Log density of all vectors relative to the background, of one joint Gaussian for each object."""
    total = 0.0
    for number in set(owners):
        rows = np.flatnonzero(np.array(owners) == number)
        turned = AZIMUTHS[rows][:, None] - AZIMUTHS[rows]
        alike = SPREAD * np.exp((np.cos(turned) - 1.0) / REACH**2)
        covariance = 1.0 - SPREAD - NOISE + alike + NOISE * np.eye(len(rows))
        products, (_, log_determinant) = VECTORS[rows] @ VECTORS[rows].T, np.linalg.slogdet(covariance)
        total += -0.5 * SIZE * (np.trace(np.linalg.solve(covariance, products) - products) + log_determinant)
    return total


def moved(to: Mapping[int, int]) -> list[tuple[int, int, int, int]]:
    """Changes: keyframe -> the object that its detection is of now."""
    return [(keyframe, 0, now, OWNERS[keyframe]) for keyframe, now in to.items()]


@pytest.mark.parametrize("to", [{2: 3, 3: 3, 5: 3, 6: 3}, {1: 7, 6: 3}, {7: 3}], ids=["merged", "exchanged", "lost"])
def test_a_reassignment_gains_the_ratio_of_two_gaussians(to: dict[int, int]) -> None:
    after = tuple(to.get(keyframe, number) for keyframe, number in enumerate(OWNERS))
    gain, records = reassigned_vectors(model(), views(model()), moved(to))
    assert gain == pytest.approx(exact(after) - exact(OWNERS), abs=1e-9)
    assert set(records) == set(after)
    for number, own in records.items():
        assert [view.detection[0] for view in own.appearance_views] == np.flatnonzero(
            np.array(after) == number
        ).tolist()


def test_a_reassignment_taken_back_leads_to_what_was() -> None:
    own = model((0.05, 0.3), (0.02, 0.1))
    there = moved({2: 3, 3: 3, 5: 3, 6: 3})
    back = [(keyframe, number, was, now) for keyframe, number, now, was in there]
    before = views(own)
    gain, after = reassigned_vectors(own, before, there)
    loss, again = reassigned_vectors(own, after, back)
    assert loss == pytest.approx(-gain, abs=1e-9)
    assert again.keys() == before.keys() and again[5] is before[5]
    for number, told in again.items():
        assert told.appearance is not None and before[number].appearance is not None
        appearances = [one.appearance for one in (told, before[number])]
        ours, theirs = (one.mean_direction(np.zeros(len(one.log_settings)))[0] for one in appearances)
        np.testing.assert_allclose(ours, theirs, atol=1e-9)

"""The latent model as inference sees it: derivatives, one function with the network that was trained."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from worlds.latent_toy import (
    DIMENSIONS,
    FEATURES,
    random_network,
    toy_directions,
    toy_model,
)

from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorModel
from semantic_slam.training.latent.torch_network import exported, imported, tanh_network
from semantic_slam.viewpoint.model import Viewpoints

STEP = 1e-6


@pytest.fixture(scope="module")
def model() -> LatentModel:
    return toy_model()


def test_fulfils_the_contract(model: LatentModel) -> None:
    contract: DescriptorModel = model
    prediction = contract.predict(toy_directions(5), np.zeros((5, DIMENSIONS)))
    assert prediction.mean.shape == prediction.sigma.shape == (5, FEATURES)
    assert prediction.by_direction.shape == (5, FEATURES, 2)
    assert prediction.by_descriptor.shape == (5, FEATURES, DIMENSIONS)
    assert contract.prior.mean.shape == (1, DIMENSIONS)
    assert contract.encode(prediction.mean).sigma.shape == (5, DIMENSIONS)
    assert contract.class_log_likelihood(contract.prior).shape == (1, 0)


def test_derivatives_are_those_of_finite_differences(model: LatentModel) -> None:
    looked, descriptors = toy_directions(20), np.random.default_rng(3).normal(size=(20, DIMENSIONS))
    prediction = model.predict(looked, descriptors)
    for column in range(2):
        sides = []
        for sign in (1.0, -1.0):
            moved = [looked.azimuth_rad.copy(), looked.elevation_rad.copy()]
            moved[column] += sign * STEP
            sides.append(model.predict(Viewpoints(moved[0], moved[1], looked.range_m), descriptors).mean)
        numeric = (sides[0] - sides[1]) / (2.0 * STEP)
        np.testing.assert_allclose(prediction.by_direction[:, :, column], numeric, atol=1e-7)
    for column in range(DIMENSIONS):
        shift = STEP * np.eye(DIMENSIONS)[column]
        numeric = model.mean(looked, descriptors + shift) - model.mean(looked, descriptors - shift)
        np.testing.assert_allclose(prediction.by_descriptor[:, :, column], numeric / (2.0 * STEP), atol=1e-7)


def test_only_the_direction_of_view_counts(model: LatentModel) -> None:
    looked, descriptors = toy_directions(4), np.zeros((4, DIMENSIONS))
    once_round = Viewpoints(looked.azimuth_rad + 2.0 * np.pi, looked.elevation_rad, 5.0 * looked.range_m)
    np.testing.assert_allclose(model.mean(looked, descriptors), model.mean(once_round, descriptors), atol=1e-12)


def test_numpy_and_torch_are_the_same_function() -> None:
    torch.manual_seed(0)
    network = tanh_network((4, 7, 5, 3))
    inputs = np.random.default_rng(0).normal(size=(6, 4))
    with torch.inference_mode():
        expected = network(torch.from_numpy(inputs).float()).numpy()
        back = imported(exported(network))(torch.from_numpy(inputs).float()).numpy()
    np.testing.assert_allclose(exported(network).value(inputs), expected, atol=1e-6)
    np.testing.assert_allclose(back, expected, atol=1e-6)


def test_tangents_agree_with_torch() -> None:
    torch.manual_seed(1)
    network = tanh_network((4, 7, 3))
    point = torch.randn(4)
    expected = torch.autograd.functional.jacobian(network, point).numpy()
    _, tangents = exported(network).value_and_tangents(point.double().numpy()[None], np.eye(4)[None])
    np.testing.assert_allclose(tangents[0].T, expected, atol=1e-6)


def test_parts_that_do_not_fit_are_refused(model: LatentModel) -> None:
    with pytest.raises(ValueError, match="encoder"):
        replace(model, encoder=random_network(np.random.default_rng(0), (FEATURES, 8, DIMENSIONS)))

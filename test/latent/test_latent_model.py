"""The latent model as inference sees it: derivatives, one function with the network that was trained."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from worlds.views.harmonic_model import HarmonicModel
from worlds.views.latent_toy import (
    DIMENSIONS,
    FEATURES,
    random_network,
    toy_model,
)

from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.contracts.descriptor_model import DescriptorModelContract
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorModel
from semantic_slam.training.latent.fitting.torch_network import exported, imported, tanh_network


@pytest.fixture(scope="module")
def model() -> LatentModel:
    return toy_model()


class TestLatentModel(DescriptorModelContract):
    @pytest.fixture
    def model(self) -> DescriptorModel:
        return toy_model()


class TestShippedModel(DescriptorModelContract):
    @pytest.fixture
    def model(self) -> DescriptorModel:
        shipped = load_latent_model(SemanticModelConfiguration(kind="latent"))
        assert shipped is not None and shipped.class_names
        return shipped


class TestHarmonicModel(DescriptorModelContract):
    """The tests' own model in closed form stands where the learned one does."""

    @pytest.fixture
    def model(self) -> DescriptorModel:
        return HarmonicModel()


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

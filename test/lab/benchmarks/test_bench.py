"""The benchmark: its literal peer computes the same, its file has the agreed form, and dropout passes are real."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.stats import ks_2samp
from semantic_slam_lab.benchmarks import classification
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.commands.bench import write
from semantic_slam_lab.peers.literal_alg_3_1 import LiteralRecursion

from semantic_slam.classification.classifier import Scores, View
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.perception.networks.alexnet import AlexNet
from semantic_slam.perception.networks.mc_dropout import class_probability_samples, dropout_generator


def test_the_literal_peer_gives_the_same_posterior() -> None:
    models, random = classification.class_models(3), np.random.default_rng(3)
    track = np.cumsum(random.normal(size=(8, 2)), axis=0)
    scores = [Scores.of(random.normal(0.5, 0.1, (5, classification.NUM_COMPONENTS))) for _ in track]
    literal, ours = LiteralRecursion(models), RecursiveClassifier(ClassProcesses(models), np.zeros(4))
    posterior = np.full(4, -np.log(4.0))
    for k in range(len(track)):
        posterior = literal.step(posterior, track[: k + 1], scores[: k + 1])
        np.testing.assert_allclose(ours.update(View(track[k][None], scores[k])), posterior, atol=1e-8)


def test_rows_are_written_in_the_agreed_form(tmp_path: Path) -> None:
    write(tmp_path / "deep" / "bench.json", [Row("a", 1.0, float("nan"), "ms", 2.0, 3, "so")], quick=True, seed=0)
    found = json.loads((tmp_path / "deep" / "bench.json").read_text(encoding="utf-8"))
    assert found["schema_version"] == 1 and found["quick"] is True and "semantic_model" in found["config"]
    assert found["revision"] and set(found["machine"]) == {"cpu", "cores", "python"}
    row = {"name": "a", "ours": 1.0, "peer": None, "unit": "ms", "ratio": 2.0, "n": 3, "how": "so"}
    assert found["results"] == [row]


@pytest.mark.slow
def test_a_short_window_loses_likelihood(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(classification, "TRACK_LENGTH", 12)
    monkeypatch.setattr(classification, "WINDOWS", (12,))
    rows = classification.window_loss(quick=True, seed=0)
    assert [row.ratio for row in rows] == pytest.approx([1.0, 1.0])  # a window over everything changes nothing
    assert all(row.peer > 0.0 for row in rows)


@pytest.mark.long
@pytest.mark.slow
def test_shared_trunk_passes_have_the_distribution_of_whole_passes() -> None:
    """Two-sample Kolmogorov-Smirnov on the likeliest classes' probabilities: AlexNet, 80 passes each way."""
    torch.manual_seed(0)
    network = AlexNet().eval()
    with torch.inference_mode():
        network.classifier[-1].weight *= 20.0  # random weights are nearly uniform otherwise
    crop = np.random.default_rng(0).integers(0, 256, (224, 224, 3), dtype=np.uint8)
    shared = class_probability_samples(network, crop, 80, dropout_generator(0, 0, 0))
    network.train()
    with torch.inference_mode():
        image = network.normalise(crop[None])
        whole = np.concatenate([torch.softmax(network(image).double(), -1).numpy() for _ in range(80)])
        network.eval()
        plain = torch.softmax(network(image).double(), -1).numpy()
    likeliest = np.argsort(-plain[0])[:5]
    for index in likeliest:
        assert ks_2samp(shared[:, index], whole[:, index]).pvalue > 1e-3
    assert shared[:, likeliest].std(axis=0).min() > 0.0
    halved = class_probability_samples(network, crop, 1, dropout_generator(0, 0, 1))
    assert ks_2samp(np.repeat(halved[:, likeliest[0]], 80), whole[:, likeliest[0]]).pvalue < 1e-3

"""Real nodes over DDS with pictures and a learned latent space: the same beliefs as offline, and a user reads along."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import input_entries, map_prior, of_topic, write_bag, write_configuration
from worlds.processes.node_runs import Replay, assert_same, beliefs, run

from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.configuration import SemanticModelConfiguration, load_configuration
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import run_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 6
EXAMPLE = [sys.executable, str(Path(__file__).parents[2] / "examples" / "print_belief.py")]


@pytest.mark.long
def test_two_backends_and_classifier_agree_with_offline_and_a_user_reads_along(tmp_path: Path) -> None:
    configuration = write_configuration(
        tmp_path / "configuration",
        semantic_model={"kind": "latent"},
        initial_pose={"mean": [0.0, 0.0, 0.0], "sigma": [2.0, 2.0, 0.5]},
        pruning={"ratio": 1e6, "max_hypotheses": 6},
        perception={"num_passes": 3},
    )
    entries = input_entries(NUM_FRAMES)
    for entry in of_topic(entries, topics.DETECTIONS):
        entry.message.labels = ["object"] * len(entry.message.labels)
    bag = write_bag(tmp_path / "camera" / "bag", entries)
    pair = map_prior().objects
    copies = [
        replace(box, object_id=box.object_id + 2 * n, pose=box.pose + np.array([0.0, shift_m, 0, 0, 0, 0, 0]))
        for n, shift_m in enumerate((0.0, 3.0))
        for box in pair
    ]
    (bag / "objects.json").write_text(MapPrior(tuple(copies)).to_json())
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    expected = beliefs(tmp_path / "offline")
    user = {"print_belief": EXAMPLE}
    replay = Replay(bag, configuration, tmp_path / "nodes", 2, commands=user, companions=("print_belief",))

    def read_at_the_end() -> list[str]:
        printed = replay.output_of("print_belief").splitlines()
        return [line for line in printed if line.startswith(f"{NUM_FRAMES - 1}: object ")]

    found = run(replay, lambda: len(read_at_the_end()) == len(copies))
    assert len(read_at_the_end()) == len(copies)
    assert_same(found, expected)
    model = load_latent_model(SemanticModelConfiguration(kind="latent"))
    assert model is not None and len(found) == len(expected) == NUM_FRAMES
    assert max(len(belief.hypothesis_ids) for belief in expected) > 1
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.descriptors.shape == (len(copies), model.num_dimensions)
        for name in ("log_weights", "descriptors", "descriptor_covariances", "class_probabilities", "poses"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-6, err_msg=name)

"""Prior samples (``weights.method: sampled``) of objects that detections name and no map holds."""

import numpy as np
import pytest
from worlds.drives.standing_robot import beliefs_at_rest

from semantic_slam.configuration import Configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.world.map_prior import MapPrior

EVEN = Detection(range_m=3.0, bearing_rad=0.1, track_id="a", class_scores={"class_1": 0.5, "class_2": 0.5})


def _first(method: str, seed: int, max_range_m: float = 0.0) -> HybridBelief:
    configuration = Configuration.of(
        seed=seed,
        association="given",
        semantic_model={"kind": "parametric", "alpha": 0.25, "concentration": 6.0},
        weights={"method": method, "num_samples": 200},
        visibility={"max_range_m": max_range_m},
    )
    return beliefs_at_rest([[EVEN]], configuration, MapPrior(()))[0]


@pytest.mark.parametrize("max_range_m", [0.0, 5.0])
def test_the_class_of_a_new_object_is_not_left_to_the_seed(max_range_m: float) -> None:
    for seed in range(3):
        drawn, exact = _first("sampled", seed, max_range_m), _first("laplace", seed, max_range_m)
        np.testing.assert_allclose(drawn.class_probabilities[0], 0.5, atol=1e-6)
        assert drawn.log_evidence == pytest.approx(exact.log_evidence, abs=1e-9)

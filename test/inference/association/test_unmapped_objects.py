"""What a map lacks: weighed as an object that may be anywhere about it, named when it is seen again, and no more."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

MAPPED = [ObjectPrior.planar(n, *place, sigma_m=0.1, sigma_rad=0.1) for n, place in ((4, (3.0, 1.0)), (7, (3.0, -1.0)))]
PROBABILITY, CLUTTER = 0.2, 0.05
UNMAPPED = 8
SEEN_AT = np.array([2.0, 0.0])


def _configuration(observation: str = "range_bearing", **closed_world: float) -> Configuration:
    settings = {"clutter_per_frame": CLUTTER, "unmapped_objects": 1, "unmapped_probability": PROBABILITY}
    return Configuration.of(
        observation=observation,
        semantic_model={"kind": "none"},
        closed_world={**settings, **closed_world},
        pruning={"ratio": 1e12},
    )


def _run(frames: list[list[Detection]], configuration: Configuration, backends: int = 1) -> list[HybridBelief]:
    engine = Engine(
        configuration, MapPrior(tuple(MAPPED)), initial_pose=np.zeros(3), initial_covariance=1e-8 * np.eye(3),
        backends=backends,
    )  # fmt: skip
    still = (1e-4, 1e-4, 1e-4)
    return [engine.process(Keyframe.planar(k, detections=own, motion_sigmas=still)) for k, own in enumerate(frames)]


def test_a_first_detection_weighs_the_prior_of_an_unmapped_object_against_false_alarms() -> None:
    belief = _run([[Detection.at(*SEEN_AT)]], _configuration("points"))[0]
    region = Configuration().open_world
    sigma = np.sqrt(np.mean([0.0, 1.0]) + 0.25 * region.max_range_m**2)
    density = multivariate_normal([3.0, 0.0], sigma**2 * np.eye(2)).pdf(SEEN_AT)  # per square metre
    area = 0.5 * region.field_of_view_rad * (region.max_range_m**2 - region.min_range_m**2)
    log_expected = np.log(PROBABILITY * density) - np.log(CLUTTER / area)
    weight = {hypothesis.associations[0]: hypothesis.weight for hypothesis in belief.hypotheses}
    assert np.log(weight[UNMAPPED] / weight[-1]) == pytest.approx(log_expected, abs=0.01)
    row = belief.object_names.index(f"unmapped_{UNMAPPED}")
    assert belief.existence[row] == pytest.approx(weight[UNMAPPED] + (1.0 - weight[UNMAPPED]) * PROBABILITY, abs=1e-9)


def test_what_shows_again_exists_where_it_is_and_what_does_not_show_stays_as_likely_as_before() -> None:
    nothing = _run([[Detection.at(3.0, 1.0)]] * 3, _configuration())[-1]
    again = _run([[Detection.at(*SEEN_AT), Detection.at(3.0, 1.0)]] * 3, _configuration())[-1]
    row = again.object_ids.tolist().index(UNMAPPED)
    assert nothing.existence[row] == pytest.approx(PROBABILITY, abs=0.02)
    assert again.existence[row] > 0.99
    np.testing.assert_allclose(again.object_poses[row, :2], SEEN_AT, atol=0.05)
    assert again.outlier_probability[0] < 0.01


def test_a_map_that_lacks_nothing_knows_no_such_object() -> None:
    for settings in ({"unmapped_objects": 0}, {"clutter_per_frame": 0.0}):
        belief = _run([[Detection.at(3.0, 1.0)]], _configuration(**settings))[0]
        assert belief.object_ids.tolist() == [4, 7] and np.isnan(belief.moved).all()


@pytest.mark.long
def test_backends_agree_on_what_the_map_lacks_to_the_bit() -> None:
    frames = [[Detection.at(*SEEN_AT), Detection.at(3.0, 1.0)], [Detection.at(*SEEN_AT)], []]
    one, three = (_run(frames, _configuration(displaced_share=0.02), backends) for backends in (1, 3))
    for own, other in zip(one, three, strict=True):
        np.testing.assert_array_equal(own.log_weights, other.log_weights)
        np.testing.assert_array_equal(own.existence, other.existence)
        np.testing.assert_array_equal(own.moved, other.moved)


def test_a_probability_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="unmapped_probability"):
        _configuration(unmapped_probability=0.0)

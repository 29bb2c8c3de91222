"""The search among candidates: factors of two, as far as evidence rises and no further."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from semantic_slam.calibration.posterior import refinements
from semantic_slam.calibration.quantities import Quantity, quantities, value_of, with_values
from semantic_slam.calibration.search import LEAST_GAIN, Search
from semantic_slam.calibration.trial import Weighed
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError

BEGIN = Configuration.of(
    association="open",
    odometry={
        "estimate_bias": True,
        "sigma_bias_rad_per_m": 0.05,
        "sigma_bias_scale": 0.04,
        "sigma_clock_offset_s": 0.2,
    },
    detection_errors={"correlated_share": 0.9},
)
ODOMETRY, DETECTIONS, SHARE, CLUTTER = quantities(BEGIN, places_are_told=False)
HERE = Path("nowhere")


def bowl(name: str, best: float, nats: float = 20.0) -> Callable[[Configuration], float]:
    """Log evidence that falls with the square of the factors of two away from the best value of one parameter."""
    return lambda own: -nats * float(np.log2(value_of(own, name) / best)) ** 2


def search_of(
    evidence: Callable[[Configuration], float], noise: dict[str, tuple[float, float]] | None = None
) -> Search:
    """A search over a made-up evidence."""

    def weigh(configurations: Sequence[Configuration]) -> list[Weighed]:
        return [Weighed(evidence(own), HERE, 5, 9, noise or {}) for own in configurations]

    return Search(weigh, BEGIN, weigh([BEGIN])[0])


def test_steps_go_as_far_as_evidence_rises() -> None:
    found = search_of(bowl("perception.sigma_range_m", 0.4))
    found.climb([ODOMETRY, DETECTIONS])
    assert found.best.perception.sigma_range_m == pytest.approx(0.4)
    assert found.best.perception.sigma_bearing_rad == pytest.approx(0.12)
    assert found.best.odometry == BEGIN.odometry
    assert found.changes["perception.sigma_range_m"].gain == pytest.approx(80.0)
    assert [own.is_kept for own in found.trials] == [False, False, True, False, True, False, False, False]


def test_a_gain_below_the_least_changes_nothing() -> None:
    found = search_of(bowl("perception.sigma_range_m", 0.2, nats=0.9 * LEAST_GAIN))
    found.climb([DETECTIONS])
    assert found.best == BEGIN and found.changes == {} and len(found.trials) == 2


def test_what_was_moved_later_is_asked_again_and_nothing_twice() -> None:
    """Twice the noise of odometry is better only where detections are worse than stated."""

    asked = []

    def evidence(own: Configuration) -> float:
        asked.append(own)
        detections = bowl("perception.sigma_range_m", 0.2, nats=60.0)(own)
        return detections + (
            bowl("odometry.sigma_rotation_per_m", 0.07)(own) if own.perception != BEGIN.perception else 0
        )

    found = search_of(evidence)
    found.climb([ODOMETRY, DETECTIONS])
    assert found.best.odometry.sigma_rotation_per_m == pytest.approx(0.07)
    assert found.best.perception.sigma_range_m == pytest.approx(0.2)
    assert len(asked) == len(set(asked)) == len(found.trials) + 1


def test_a_change_that_is_taken_back_is_none() -> None:
    found = search_of(bowl("perception.sigma_range_m", 0.2))
    found.climb([DETECTIONS])
    found.weigh = lambda configurations: [Weighed(1e3, HERE, 5, 9) for _ in configurations]
    found._known = {found.best: found.outcome}
    found._best_of([(DETECTIONS.name, DETECTIONS.stepped(found.best, -1))])
    assert found.best == BEGIN and found.changes == {}


def test_what_shares_leave_is_doubled_and_limits_are_kept() -> None:
    assert SHARE.stepped(BEGIN, 1) == {"detection_errors.correlated_share": 0.8}
    assert SHARE.stepped(BEGIN, -1) == {"detection_errors.correlated_share": 0.95}
    assert SHARE.stepped(BEGIN, 4) == {"detection_errors.correlated_share": 0.0}
    found = search_of(lambda own: 1e4 * own.detection_errors.correlated_share)
    found.climb([SHARE])
    assert found.best.detection_errors.correlated_share == pytest.approx(0.9875)
    assert "must lie in" in found.trials[-1].fault and found.trials[-1].log_evidence == -np.inf


def test_a_run_of_other_keyframes_cannot_be_compared() -> None:
    first, other = Weighed(-3.0, HERE, 5, 9), Weighed(80.0, HERE, 5, 8)
    assert other.beside(first).log_evidence == -np.inf and "5 keyframes with 8 detections" in other.beside(first).fault
    assert first.beside(first) == first


@pytest.mark.parametrize(
    ("association", "clutter"),
    [
        ("open", "open_world.clutter_per_frame"),
        ("enumerated", "closed_world.clutter_per_frame"),
        ("given", "closed_world.wrong_identity_share"),
    ],
)
def test_each_association_has_its_own_clutter(association: str, clutter: str) -> None:
    found = quantities(Configuration.of(association=association), places_are_told=False)
    assert found[-1].parameters == (clutter,)
    assert SHARE.name not in {item.name for item in found}  # where nothing repeats


def test_told_covariances_are_scaled_by_their_factor() -> None:
    detections = quantities(BEGIN, places_are_told=True)[1]
    assert detections.stepped(BEGIN, 1) == {"perception.noise_factors": [4.0]}


def test_what_was_inferred_is_expected_next_time() -> None:
    noise: dict[str, tuple[float, float]] = {
        "odometry.bias_rad_per_m": (0.031234, 0.002),
        "odometry.bias_scale": (-0.01, 0.03),
        "odometry.clock_offset_s": (0.2, 0.01),
        "open_world.detection_probability": (0.5, 0.1),
        "open_world.detection_half_range_m": (4.0, 1.0),
        **{f"open_world.{name}": (1.5, np.nan) for name in ("min_range_m", "field_of_view_rad", "direction_rad")},
        "open_world.max_range_m": (7.0, np.nan),
    }
    found = refinements(BEGIN, noise)
    assert found["biases of odometry"] == {
        "odometry.bias_rad_per_m": 0.03123,
        "odometry.sigma_bias_rad_per_m": 0.025,  # half of before, as more may change until the next drive
        "odometry.bias_scale": -0.01,
        "odometry.sigma_bias_scale": 0.03,
    }
    assert found["clock of odometry"] == {"odometry.clock_offset_s": 0.2, "odometry.sigma_clock_offset_s": 0.1}
    probabilities: Any = found["detection probability"]["open_world.detection_probabilities"]
    assert probabilities == pytest.approx([1.0 / 3.0, 0.5, 2.0 / 3.0], abs=1e-4)
    half_ranges: Any = found["fall-off with range"]["open_world.detection_half_ranges_m"]
    assert half_ranges == pytest.approx([2.828, 4.0, 5.657], abs=1e-3)
    region = with_values(BEGIN, found["region of the sensor"]).open_world
    assert (region.learn_region, region.max_range_m, region.field_of_view_rad) == (False, 7.0, 1.5)
    assert refinements(BEGIN, {}) == {}
    assert refinements(BEGIN, {"open_world.detection_half_range_m": (np.inf, np.nan)}) == {}  # maybe no fall-off at all
    assert refinements(BEGIN, {"open_world.clutter_per_frame": (0.0, 0.0)})["clutter"] == {
        "open_world.clutters_per_frame": [0.0]
    }


def test_refinements_are_kept_one_by_one() -> None:
    noise = {"odometry.bias_rad_per_m": (0.03, 0.01), "open_world.detection_probability": (0.5, 0.1)}
    found = search_of(lambda own: 100.0 * own.odometry.bias_rad_per_m / 0.03, noise)
    found.refine()
    assert found.best.odometry.bias_rad_per_m == 0.03
    assert found.best.open_world.detection_probabilities == BEGIN.open_world.detection_probabilities
    assert [own.is_kept for own in found.trials] == [True, False]


def test_a_value_beyond_its_limits_is_refused() -> None:
    with pytest.raises(InputError, match="correlated_share"):
        with_values(BEGIN, {"detection_errors.correlated_share": 1.0})


def test_zero_stays_zero() -> None:
    assert Quantity("turn", ("odometry.sigma_translation_per_m",)).stepped(
        with_values(BEGIN, {"odometry.sigma_translation_per_m": 0.0}), 1
    ) == {}  # fmt: skip

"""Up to the range within which the region is learned, and beyond: detections and region agree."""

import numpy as np
import pytest

from semantic_slam import Engine
from semantic_slam.configuration import Configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.sensed_region import SensedRegion

WITHIN_M, NUM_KEYFRAMES = 5.0, 6
BEARINGS = (-0.5, 0.5)
FAR = ((6.2, 1.0), (7.0, -1.0), (6.5, 2.5))


def at_rest(association: str, keyframes: list[list[Detection]], within_m: float) -> tuple[Engine, HybridBelief]:
    engine = Engine(
        Configuration.of(
            association=association,
            semantic_model={"kind": "none"},
            open_world={"learn_region": True, "learn_region_within_m": within_m, "iterate_updates": False},
        )
    )
    beliefs = [
        engine.process(Keyframe.planar(k, detections=own, motion_sigmas=(1e-2,) * 3)) for k, own in enumerate(keyframes)
    ]
    return engine, beliefs[-1]


def of_ranges(ranges_m: list[float]) -> list[Detection]:
    bearings = BEARINGS[: len(ranges_m)]
    return [Detection(range_m=r, bearing_rad=b) for r, b in zip(ranges_m, bearings, strict=True)]


@pytest.mark.parametrize("ranges_m", [[2.0, 7.0], [6.2, 7.0]])
def test_an_engine_leaves_out_what_a_run_of_a_bag_does(ranges_m: list[float]) -> None:
    engine, belief = at_rest("open", [of_ranges(ranges_m)] * NUM_KEYFRAMES, WITHIN_M)
    near = [own for own in ranges_m if own <= WITHIN_M]
    alone, told = at_rest("open", [of_ranges(near)] * NUM_KEYFRAMES, WITHIN_M)
    assert belief.dropped == NUM_KEYFRAMES * (len(ranges_m) - len(near)) and told.dropped == 0
    assert engine.log_evidence == alone.log_evidence and belief.noise == told.noise
    np.testing.assert_array_equal(belief.object_poses, told.object_poses)
    assert len(belief.objects) == len(near)


def test_where_misses_do_not_count_all_detections_are_used_and_the_region_holds_them() -> None:
    def named(swapped: bool) -> list[Detection]:
        names = ("b", "a", "c") if swapped else ("a", "b", "c")
        return [Detection.at(*at, track_id=name) for at, name in zip(FAR, names, strict=True)]

    keyframes = [named(k == NUM_KEYFRAMES - 2) for k in range(NUM_KEYFRAMES)]
    (engine, belief), (unlimited, without) = (at_rest("given", keyframes, own) for own in (WITHIN_M, 0.0))
    assert engine.log_evidence == unlimited.log_evidence
    np.testing.assert_array_equal(belief.object_poses, without.object_poses)
    np.testing.assert_allclose(belief.object_poses[:, :2], FAR, atol=0.05)


def test_what_is_detected_beyond_tells_nothing_of_the_region() -> None:
    assert SensedRegion.of(np.array([6.0]), np.array([0.1]), most_m=WITHIN_M) is None
    ranges, bearings = np.array([2.0, 7.0, np.nan]), np.array([0.1, 1.5, -0.2])
    found = SensedRegion.of(ranges, bearings, most_m=WITHIN_M)
    assert found == SensedRegion.of(ranges[[0, 2]], bearings[[0, 2]], most_m=WITHIN_M)
    assert SensedRegion.of(np.array([9.0]), np.array([2.0]), found) == found

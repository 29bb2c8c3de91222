"""Hypotheses that differ in how much of a detection's error repeats: evidence decides."""

import numpy as np
import pytest
from worlds.drives.noise_roots import engine_after, weights_of_roots
from worlds.drives.open_room import Room, make_room
from worlds.same_beliefs import assert_same

from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool

SHARES = [0.3, 0.97]
ERRORS = {"correlated_share": 0.9, "outlier_share": 0.02}


def room_of(shares: list[float], num_keyframes: int, ratio: float = 1e9, **errors: object) -> Room:
    return make_room(
        num_keyframes,
        clutter=0.05,
        semantic_model={"kind": "none"},
        moving={"share": 0.1},
        detection_errors={**ERRORS, "correlated_shares": shares, **errors},
        open_world={"iterate_updates": False, "merge_position_m": 0.0},
        pruning={"ratio": ratio, "max_hypotheses": 400},
    )


@pytest.mark.long
def test_evidence_is_the_average_over_the_shares() -> None:
    """Without merging and with next to nothing pruned each share has a belief of its own, as if it were configured."""
    alone = [engine_after(room_of([], 3, correlated_share=share)).log_evidence for share in SHARES]
    both = engine_after(room_of(SHARES, 3))
    assert abs(alone[0] - alone[1]) > 0.01
    assert both.log_evidence == pytest.approx(np.logaddexp(*alone) - np.log(2.0), abs=1e-6)
    np.testing.assert_allclose(weights_of_roots(both, len(SHARES)), np.exp(alone - np.logaddexp(*alone)), atol=1e-6)


@pytest.mark.slow
def test_a_lineage_is_rebuilt_under_its_share() -> None:
    room = room_of(SHARES, 8, 150.0)
    whole, divided = (Engine.of_run(room.run, pool) for pool in (InProcessPool(2), ForgetfulPool(2)))
    for keyframe in room.keyframes:
        belief = whole.process(keyframe)
        assert_same(divided.process(keyframe), belief)
    assert {live.lineage[0].mode for live in whole.live.values()} == {0, 1}
    assert "detection_errors.correlated_share" in belief.noise_names


@pytest.mark.parametrize(
    "errors", [{"correlated_shares": [1.0]}, {"correlated_shares": [0.9], "correlated_share": 0.0}]
)
def test_what_cannot_work_is_refused(errors: dict[str, object]) -> None:
    with pytest.raises(InputError, match="correlated_shares"):
        make_room(
            1,
            open_world={"iterate_updates": False},
            semantic_model={"kind": "none"},
            detection_errors={**ERRORS, **errors},
        )

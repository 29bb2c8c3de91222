"""The study replay_scaling: equality is told from difference, what is out of time is reported, the page is written."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.studies.replay_scaling import study
from semantic_slam_lab.studies.replay_scaling.study import belief_difference, replay, world_of


@pytest.mark.long
@pytest.mark.slow
def test_two_backends_state_the_belief_of_one_and_the_page_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "QUICK_SIZES", (10,))
    monkeypatch.setattr(study, "QUICK_LIMIT_S", 300.0)
    data, page = study.run(tmp_path, quick=True, jobs=1, seed=0)
    result = json.loads(data.read_text(encoding="utf-8"))
    single, double = result["replays"]
    assert (single["backends"], double["backends"]) == (1, 2)
    assert all(row["finished"] and row["peak_rss_mb"] > 0.0 for row in result["replays"])
    assert double["keyframes_compared"] == study.QUICK_KEYFRAMES
    assert double["belief_difference"] <= 1e-9
    assert {"ms_per_keyframe_p50_10_objects_1_backends", "method"} <= result["methods"]["ours"].keys()
    assert "Two backends state the same belief as one" in page.read_text(encoding="utf-8")


def test_a_replay_out_of_time_keeps_what_it_reached() -> None:
    found = replay(world_of(10, 2, seed=0), num_backends=1, limit_s=1e-3)
    assert not found.finished and found.beliefs == [] and found.peak_rss_mb is None
    (row,) = study.rows_of([found])
    assert row["ms_per_keyframe_p50"] is None and row["keyframes"] == 0 and row["keyframes_wanted"] == 2


def test_beliefs_differ_by_their_largest_difference() -> None:
    from semantic_slam_lab.grid.run import keyframes_of, run_of

    from semantic_slam.inference.engine import Engine
    from semantic_slam.inference.pool import InProcessPool

    world = world_of(10, 1, seed=0)
    belief = Engine.of_run(run_of(world), InProcessPool(1)).process(keyframes_of(world)[0])
    unknown = dataclasses.replace(belief, existence=np.full_like(belief.existence, np.nan))
    assert belief_difference(belief, belief) == belief_difference(unknown, unknown) == 0.0
    assert belief_difference(belief, unknown) == np.inf
    moved = dataclasses.replace(belief, existence=belief.existence + np.eye(len(belief.existence))[0] * 1e-3)
    assert belief_difference(belief, moved) == pytest.approx(1e-3)
    renamed = dataclasses.replace(belief, hypothesis_ids=belief.hypothesis_ids + np.uint64(1))
    assert belief_difference(belief, renamed) == np.inf
    fewer = dataclasses.replace(belief, log_weights=belief.log_weights[1:])
    assert belief_difference(belief, fewer) == np.inf

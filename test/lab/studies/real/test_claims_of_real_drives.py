"""What the study of real drives claims: of what was run, and not where a run failed."""

from typing import Any

import pytest
from semantic_slam_lab.studies.real_drives.claims import claims_of
from semantic_slam_lab.studies.real_drives.scores import EVERY_METRIC
from semantic_slam_lab.studies.result import Claim

GOOD: dict[str, Any] = {
    "f1_of_ceiling": 1.0,
    "association_f1": 1.0,
    "association_f1_clusters": 1.0,
    "pair_right_at_90": 1.0,
    "region95_held": 1.0,
    "num_objects": 15,
    "ghosts": 0,
    "pair_ece": 0.01,
    "nees_mean": 3.0,
    "region95_median_radius_m": 0.2,
    "ate_aligned_m": 0.1,
    "dead_reckoning_ate_aligned_m": 1.0,
    "log_density": 1.0,
    "parked_recall": 1.0,
    "moving_recall": 1.0,
    "robots_called_moving": 1.0,
    "cpu_s": 10.0,
}
WORSE = {**GOOD, "ate_aligned_m": 0.15, "log_density": 0.0}
FAILED: dict[str, Any] = {**dict.fromkeys(EVERY_METRIC), "fault": "it crashed"}
ENDED_EARLY = {**GOOD, "fault": "it ended early"}
EVERY_METHOD = {
    "ours": GOOD,
    "given": GOOD,
    "batch_cauchy": GOOD,
    "with_robots": GOOD,
    **dict.fromkeys(("one_hypothesis", "nearest_neighbour", "jcbb"), WORSE),
    **dict.fromkeys(("without_correlation", "without_outliers", "without_estimated_noise"), WORSE),
}


def claims(**drives: dict[str, Any]) -> dict[str, Claim]:
    """Text -> claim; drives by name, with the rows of the methods that were run."""
    found = claims_of({name.replace("__", "/"): {"methods": methods} for name, methods in drives.items()})
    return {claim.text: claim for claim in found}


def test_claims_are_made_of_what_was_run() -> None:
    one = {"ours": GOOD, "jcbb": WORSE}
    alone = claims(mrclam_d9__1=one)
    assert all(claim.holds for claim in alone.values())
    assert [text for text in alone if "jcbb" in text] == [
        "Mean ATE below that of jcbb",
        "Mean cluster F1 not below that of jcbb, or at least 0.99",
    ]
    assert not any("given" in text for text in alone)
    both = claims(mrclam_d9__1=one, mrclam_d9__2={"ours": {**GOOD, "nees_mean": None}})
    assert not both["NEES of the pose between 0.5 and 6"].holds
    assert "Mean ATE below that of jcbb" not in both, "jcbb was not run on the second robot"


@pytest.mark.parametrize("row", [FAILED, ENDED_EARLY])
@pytest.mark.parametrize("failing", ["mrclam_d9__2", "dlr", "kitti_tracking__0001"])
def test_no_claim_about_ours_holds_where_it_failed_on_a_drive(failing: str, row: dict[str, Any]) -> None:
    """Neither a crash nor the good beginning of a run that ended early is what was asked for."""
    good = {"mrclam_d9__1": EVERY_METHOD, "mrclam_d9__2": EVERY_METHOD} if "mrclam" in failing else {}
    given_or_robots = ("Numbers given", "At least 80 % of the other robots")
    own = {
        text: claim
        for text, claim in claims(**{**good, failing: {**EVERY_METHOD, "ours": row}}).items()
        if not text.startswith(given_or_robots)
    }
    assert len(own) == {"mrclam_d9__2": 18, "dlr": 3, "kitti_tracking__0001": 4}[failing]
    assert not any(claim.holds for claim in own.values())
    assert all(f"ours failed on {failing.replace('__', '/')}" in claim.measured for claim in own.values())


@pytest.mark.parametrize("method", [method for method in EVERY_METHOD if method != "ours"])
def test_a_comparison_with_what_failed_on_a_drive_stays_and_does_not_hold(method: str) -> None:
    whole = claims(mrclam_d9__1=EVERY_METHOD, mrclam_d9__2=EVERY_METHOD)
    found = claims(mrclam_d9__1=EVERY_METHOD, mrclam_d9__2={**EVERY_METHOD, method: FAILED})
    assert found.keys() == whole.keys()
    assert {text for text, claim in found.items() if not claim.holds} == {
        text for text, claim in found.items() if f"{method} failed on mrclam_d9/2" in claim.measured
    }
    assert not all(claim.holds for claim in found.values())


@pytest.mark.parametrize(("own", "holds"), [(0.991, True), (0.989, False)])
def test_clusters_may_be_below_those_of_a_baseline_from_099_on(own: float, holds: bool) -> None:
    rows = {"ours": {**GOOD, "association_f1_clusters": own}, "jcbb": WORSE}
    text = "Mean cluster F1 not below that of jcbb, or at least 0.99"
    assert claims(mrclam_d9__1=rows)[text].holds is holds

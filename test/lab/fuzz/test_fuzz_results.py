"""What fuzzing leaves behind: the cases by target, and claims that fail where anything was found."""

import json
from pathlib import Path

from semantic_slam_lab.fuzz.results import Finding, Forged, Fuzzed, write_forged, write_fuzzed

FINDING = Finding(target="maps", index=7, what="KeyError: 'a'", where="map_file.py:3")


def fuzzed(*findings: Finding | None) -> Fuzzed:
    found = Fuzzed()
    for own in findings:
        found.note("maps", own)
    found.note("bags", None)
    return found


def test_what_is_alike_is_one_finding_and_no_case_at_all_shows_nothing(tmp_path: Path) -> None:
    write_fuzzed(tmp_path, fuzzed(None, FINDING, FINDING), seed=3, seconds=1.0)
    told = json.loads((tmp_path / "result.json").read_text())
    assert told["targets"] == {"bags": {"cases": 1, "findings": 0}, "maps": {"cases": 3, "findings": 1}}
    assert told["findings"] == ["maps --index 7 (2 times): KeyError: 'a' at map_file.py:3"]
    assert [claim["holds"] for claim in told["claims"]] == [False]
    assert fuzzed(None).claim.holds and not Fuzzed().claim.holds


def forged(*findings: str) -> Forged:
    counted = {("backend_0", "/commit", "garbage"): 2, ("backend_0", "/keyframe", "garbage"): 3}
    return Forged(
        num_messages=6, counted=counted, refused={"/reset": 1}, largest_difference=0.0, findings=list(findings)
    )


def test_forgeries_are_told_by_node_and_kind_over_all_topics(tmp_path: Path) -> None:
    write_forged(tmp_path, forged(), seed=0)
    told = json.loads((tmp_path / "result.json").read_text())
    assert told["forgeries"] == [["backend_0", "garbage", "5"], ["/reset", "refused", "1"]]
    assert told["claims"][0]["holds"] and not forged("backend_0 died").claim.holds
    assert list(forged("backend_0 died").lines)[-2:] == ["backend_0 died", "6 messages, 1 findings"]

"""The exact fixture in space is what its script makes: the same problem, and the same answer from fewer draws."""

import json
from pathlib import Path

import pytest
import semantic_slam_lab.exact.spatial as exact

FIXTURE = json.loads((Path(__file__).parents[1] / "fixtures" / "ch4_se3_N3_k2_n2.json").read_text(encoding="utf-8"))

PROBLEMS = exact.problem().given, FIXTURE["input"]


def test_the_fixture_is_of_the_script_s_problem() -> None:
    """To rounding, which is not the same on all processors."""
    made, kept = (json.loads(json.dumps(own), parse_float=lambda text: f"{float(text):.9f}") for own in PROBLEMS)
    assert made == kept


def test_few_draws_agree_with_the_fixture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact, "DRAWS", exact.CHUNK)
    row = max(FIXTURE["expected"]["hypotheses"], key=lambda own: own["weight"])
    found = exact.sampled(exact.problem(), tuple(map(tuple, row["beta"])), seed=9)
    assert found.log_evidence == pytest.approx(row["log_evidence"], abs=4.0 * found.relative_error)
    assert found.relative_error < 0.03

"""What a report says of discarded probability: that of the last keyframes heads and warns, the sum is a number."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, run_configuration, small_belief

from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.inference.hypotheses import RECENT_KEYFRAMES
from semantic_slam.report.comparison import Run
from semantic_slam.report.document import Analysis, analyse, report_document
from semantic_slam.report.drawing.charts import discarded_chart
from semantic_slam.report.page import render_page
from semantic_slam.report.plain_json import to_text
from semantic_slam.report.summary import summary_files, summary_row
from semantic_slam.report.verdict import warnings

OFTEN_A_LITTLE = 1.0 - 0.998 ** np.arange(1, 81)
"""Since the start, of a good map: 0.2 % at each of 80 keyframes, 15 % in the end."""
LATELY = 1.0 - 0.998**RECENT_KEYFRAMES


def analysis_of(total: float, lately: float) -> Analysis:
    """A run that ends with these discarded masses."""
    beliefs = tuple(
        dataclasses.replace(
            small_belief(k, [1], [0], [1.0], [1, 2], [[0, 1]]),
            discarded_mass=total,
            discarded_mass_window=lately,
            log_evidence=-3.0,
        )
        for k in range(2)
    )
    nowhere = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))
    record = Record(run_configuration(Path("drive"), CLASSES, tuple("1234567")), beliefs, nowhere, {}, None)
    return analyse(record, Path("belief"), "")


def test_what_a_good_map_discarded_in_a_long_drive_is_no_warning() -> None:
    assert OFTEN_A_LITTLE[-1] > 0.14
    assert warnings(analysis_of(OFTEN_A_LITTLE[-1], LATELY), []) == []


@pytest.mark.parametrize("total", [0.08, 0.9])
def test_what_was_discarded_of_late_is_a_warning_that_says_when(total: float) -> None:
    (warning,) = warnings(analysis_of(total, 0.08), [])
    assert warning.startswith("8 % of the probability mass was discarded in the last 10 keyframes;")


def test_beliefs_of_older_versions_that_do_not_say_it_raise_no_warning() -> None:
    assert warnings(analysis_of(0.5, np.nan), []) == []
    page = render_page([Run("old", analysis_of(0.5, np.nan))], None)
    assert "<dd>–<small>50 % since the start</small></dd>" in page


def test_the_page_heads_with_the_last_keyframes_and_states_the_sum_beside_them() -> None:
    page = render_page([Run("one", analysis_of(0.15, 0.02)), Run("two", analysis_of(0.4, 0.03))], None)
    assert "<dt>Discarded, last 10 keyframes</dt><dd>2 %<small>15 % since the start</small></dd>" in page
    assert re.search(r"last 10 keyframes\">3 %</td>\s*<td[^>]*in all\">40 %</td>", page)
    assert "no better than that" not in page


def test_the_chart_draws_both_and_says_what_they_mean() -> None:
    chart = discarded_chart(analysis_of(0.15, 0.02).record.beliefs)
    assert [(key.name, key.values[-1]) for key in chart.keys] == [
        ("last 10 keyframes", 0.02),
        ("since the start", 0.15),
    ]
    assert str(chart.svg).count("<polyline") == 2 and "found again later is taken off both" in chart.text


@pytest.mark.parametrize(("lately", "shown"), [(0.02, "2 %"), (np.nan, "–")])
def test_the_summary_of_many_bags_has_both(lately: float, shown: str, tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text(to_text(report_document(analysis_of(0.15, lately))))
    files = summary_files([summary_row("drive", Path("drive"), tmp_path, "")])
    (row,) = json.loads(files["summary.json"])["bags"]
    assert row["discarded_mass"] == 0.15 and row["discarded_mass_window"] == (None if np.isnan(lately) else lately)
    assert re.search(rf'data-name="Discarded"[^>]*>{shown}</td>', files["index.html"])
    assert re.search(r'data-name="Discarded in all"[^>]*>15 %</td>', files["index.html"])

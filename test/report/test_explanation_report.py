"""What a report says of beliefs that do not explain their data."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from worlds.belief_factory import CLASSES, run_configuration, small_belief

from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.document import analyse, report_document
from semantic_slam.report.drawing.explanation_charts import explanation_charts, innovation_band
from semantic_slam.report.plain_json import to_text
from semantic_slam.report.summary import summary_row
from semantic_slam.report.verdict import unexplained


def beliefs_of(probabilities: Sequence[float]) -> tuple[HybridBelief, ...]:
    return tuple(
        dataclasses.replace(
            small_belief(4 + k, [1], [0], [1.0], [1, 2], [[0, 1]]),
            unexplained=own,
            log_evidence=-3.0,
            innovation_nees=1.2,
            association_probabilities=np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5]]),
        )
        for k, own in enumerate(probabilities)
    )


def record_of(beliefs: tuple[HybridBelief, ...]) -> Record:
    nowhere = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))
    return Record(run_configuration(Path("drive"), CLASSES, tuple("1234567")), beliefs, nowhere, {}, None)


@pytest.mark.parametrize(
    ("probabilities", "said"),
    [
        ([0.0, 0.1, 0.4], ""),
        ([np.nan, np.nan], ""),
        ([0.9, 0.1, 0.8, 0.99], "cannot explain its data since keyframe 6:"),
        ([0.9, 0.9], "cannot explain its data since keyframe 4:"),
        ([0.1, 0.9, 0.8, 0.2], "could not explain its data in 2 of 4 keyframes; in the end it can."),
        ([0.1, 0.9, np.nan], "could not explain its data in 1 of 3 keyframes; in the end it is not known whether"),
        ([0.1, np.nan, np.nan], "In 2 of 3 keyframes it is not known"),
    ],
)
def test_the_verdict_says_since_when(probabilities: list[float], said: str) -> None:
    found = unexplained(beliefs_of(probabilities))
    assert said in found and bool(said) == bool(found)


@pytest.mark.parametrize(
    ("probabilities", "share"), [([np.nan, 0.9, 0.1, np.nan], 0.5), ([0.1, 0.2], 0.0), ([np.nan, np.nan], None)]
)
def test_the_summary_of_many_bags_counts_only_keyframes_that_state_it(
    probabilities: list[float], share: float | None, tmp_path: Path
) -> None:
    document = report_document(analyse(record_of(beliefs_of(probabilities)), Path("belief"), ""))
    (tmp_path / "report.json").write_text(to_text(document))
    assert summary_row("drive", Path("drive"), tmp_path, "").unexplained == share


def test_the_band_is_that_of_the_detections_of_known_objects() -> None:
    low, high = innovation_band(record_of(beliefs_of([0.1])))
    assert low[0] == pytest.approx(chi2.ppf(0.025, 3) / 3) and high[0] == pytest.approx(chi2.ppf(0.975, 3) / 3)


def test_charts_of_what_no_belief_says_are_left_out() -> None:
    assert len(explanation_charts(record_of(beliefs_of([0.1, 0.7])))) == 3
    older = [
        dataclasses.replace(own, log_evidence=np.nan, innovation_nees=np.nan) for own in beliefs_of([np.nan, np.nan])
    ]
    assert explanation_charts(record_of(tuple(older))) == []


def test_every_keyframe_of_the_document_says_how_well_it_was_explained() -> None:
    document = report_document(analyse(record_of(beliefs_of([0.1, 0.7])), Path("belief"), ""))
    found = [(row["log_evidence"], row["innovation_nees"], row["unexplained"]) for row in document["keyframes"]]
    assert found == [(-3.0, 1.2, 0.1), (-3.0, 1.2, 0.7)]
    assert all(np.isnan(row["discarded_mass_window"]) for row in document["keyframes"])


def test_small_innovations_are_told_apart() -> None:
    beliefs = beliefs_of([0.1] * 3)
    small = (1.2, 2e-3, 2e-4)
    told = tuple(dataclasses.replace(own, innovation_nees=nees) for own, nees in zip(beliefs, small, strict=True))
    chart = next(chart for chart in explanation_charts(record_of(told)) if chart.title == "Innovations (NIS)")
    (points,) = re.findall(r'<polyline class="line first" points="([^"]*)"', str(chart.svg))
    heights = [float(point.partition(",")[2]) for point in points.split()]
    assert heights[0] + 20 < heights[1] and heights[1] + 20 < heights[2]
    assert "the scale" not in str(chart.svg)

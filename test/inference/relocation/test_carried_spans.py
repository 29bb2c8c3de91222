"""A run tells in which keyframes the robot was taken for carried: in diagnostics, in the report, at the console."""

from collections import Counter
from dataclasses import replace
from json import dumps
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, run_configuration, small_belief

from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration, to_dict
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.relocation.carried_spans import CarriedSpans, Spans, carried_line, spans_of, spans_text
from semantic_slam.messages import topics
from semantic_slam.pipeline.diagnostics import dropped_message
from semantic_slam.report.document import analyse, report_document
from semantic_slam.report.verdict import warnings

SPANS = ((2, 2), (5, 17), (40, 41))


def noted(probabilities: list[float]) -> Spans:
    spans = CarriedSpans()
    for keyframe, probability in enumerate(probabilities):
        spans.note(keyframe, probability)
    return spans.spans


def test_keyframes_after_one_another_are_one_span() -> None:
    assert noted([0.0, 0.5, 0.51, 0.2, 0.9, 1.0, 0.9, float("nan"), 1.0]) == ((2, 2), (4, 6), (8, 8))
    assert noted([]) == noted([0.0, 0.1]) == ()


@pytest.mark.parametrize("spans", [SPANS, SPANS[:1], ()])
def test_spans_are_read_from_their_text(spans: Spans) -> None:
    assert spans_of(spans_text(spans)) == spans


def test_the_line_names_them_and_what_to_do() -> None:
    assert "in keyframes 2, 5 to 17, 40 to 41; if nobody" in carried_line(SPANS)
    assert "in keyframe 2; if nobody" in carried_line(SPANS[:1])
    assert "not as open_world says: ask semantic_slam doctor, or set revision" in carried_line(SPANS)


def test_where_the_region_is_learned_it_names_what_is_not() -> None:
    """Doctor compares detections with a region that is stated."""
    line = carried_line(SPANS, learns_region=True)
    assert "doctor" not in line and "the sensor is panned" in line
    assert "open_world.detection_probabilities or detection_half_ranges_m, or set revision" in line


@pytest.mark.parametrize(("spans", "learned"), [(SPANS, False), (SPANS, True), ((), False)])
def test_the_report_of_a_recorded_run_says_so(tmp_path: Path, spans: Spans, learned: bool) -> None:
    """The newest diagnostics count; those of other nodes are silent on it."""
    settings = Configuration.of(association="open", open_world={"learn_region": learned})
    run = replace(run_configuration(Path("drive"), CLASSES, tuple("1234567")), configuration=dumps(to_dict(settings)))
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(topics.RUN_CONFIGURATION, run, 1)
        writer.write(topics.BELIEF, small_belief(0, [1], [0], [1.0], [0], [[0]]), 1)
        for stamp, told in enumerate((spans[:1], spans, ()), start=1):
            writer.write(topics.DIAGNOSTICS, dropped_message(stamp, {"classifier": Counter()}, told), stamp)
    analysis = analyse(read_record(tmp_path / "bag"), tmp_path / "bag", "")
    assert analysis.record.carried == spans and analysis.record.dropped == {}
    assert report_document(analysis).get("carried", []) == np.array(spans).tolist()
    assert [own for own in warnings(analysis, []) if "carried" in own] == (
        [f"T{carried_line(spans, learns_region=learned)[1:]}."] if spans else []
    )

"""Check of time matching: detections without an image or depth image of their stamp."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.checks.raw_pictures import are_lost
from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.geometry.arrays import Array

NAME = "matching"
SOME, MOST = 0.05, 0.5


def check(summary: InputSummary) -> Iterator[Finding]:
    found = summary.found
    seen = summary.stamps_of(found.detections)
    if not found.image or not len(seen):
        return
    for topic in (found.image, found.depth):
        pictures = summary.stamps_of(topic)
        if topic and len(pictures) > 1 and not are_lost(summary, topic):
            faults = list(_apart(summary, topic, seen.distances_s(pictures), pictures.usual_step_s))
            yield from faults
            if faults:  # of depth they would be the same
                return


def _apart(summary: InputSummary, topic: str, apart_s: Array, step_s: float) -> Iterator[Finding]:
    tolerance_s = summary.configuration.perception.sync_tolerance_s
    lost = apart_s > tolerance_s
    if lost.mean() <= SOME:
        return
    is_needed = topic == summary.found.image
    usual_s = float(np.median(apart_s[lost]))
    wider = f"set perception.sync_tolerance_s: {1.2 * usual_s:.2g}" if usual_s < 0.5 * step_s else ""
    yield Finding(
        Severity.ERROR if is_needed and lost.mean() > MOST else Severity.WARNING,
        NAME,
        f"{int(lost.sum())} of {len(lost)} messages of {summary.found.detections} have no {topic} within"
        f" {tolerance_s:g} s (perception.sync_tolerance_s); the nearest is {usual_s:.3g} s away",
        _remedy_for_pictures(wider) if is_needed else _remedy_for_depth(wider),
    )


def _remedy_for_pictures(wider: str) -> str:
    """``wider``: the tolerance that holds the pictures' distance, "" where that is not constant."""
    return "have the detector copy the image's stamp" + (f", or {wider}" if wider else "")


def _remedy_for_depth(wider: str) -> str:
    """``wider`` as for pictures; depth of the next picture is another view, and none leaves bearings alone."""
    if wider:
        return f"{wider}, or have the camera stamp depth as its pictures; those detections are bearings alone"
    return "record depth with every picture; those detections are bearings alone"

"""Check of boxes: several of one object, not finite, in shares of the image, outside it, or of another size of it."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, Severity, error, warning
from semantic_slam.doctor.input_summary import LARGEST_OVERLAP, DetectionRecord, InputSummary
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.perception.crops import are_in_shares

NAME = "boxes"
DOUBLED = 0.2
"""Share of the messages with boxes in which two of one object are reported."""
SOME, MOST = 0.05, 0.5
"""Smallest share of faulty boxes that is reported, and the share that counts as most of them."""
BEYOND = 0.1
"""Share of the image size by which boxes at its border may extend beyond it."""
CORNER, LEAST_BOXES = 0.6, 100
"""So many boxes that all lie within that share of width and height are of a smaller picture."""


def check(summary: InputSummary) -> Iterator[Finding]:
    boxes = summary.detections.boxes
    are_finite = np.asarray(np.isfinite(boxes).all(axis=1))
    is_wanted = summary.found.has_images or ~np.isnan(boxes).all(axis=1)  # places without pictures need no box
    yield from _doubled(summary.detections)
    yield from _not_finite(~are_finite & is_wanted)
    boxes = boxes[are_finite]
    if not len(boxes):
        return
    shares = are_in_shares(boxes)
    if shares.mean() > SOME:
        yield error(
            NAME,
            f"{_count(shares)} boxes lie within the first pixel: they are in shares of the picture",
            "give boxes in pixels: multiply x by the picture's width and y by its height",
        )
        return
    flat = np.asarray((boxes[:, 2:] <= boxes[:, :2]).any(axis=1))
    if flat.mean() > SOME:
        yield error(
            NAME,
            f"{_count(flat)} boxes have no area",
            "give x_min y_min x_max y_max, not the centre or a corner with width and height",
        )
        return
    if summary.camera is not None:
        yield from _in_picture(boxes, summary.camera.width, summary.camera.height)


def _doubled(seen: DetectionRecord) -> Iterator[Finding]:
    num_with_boxes = seen.frames_of_boxes.total()
    if seen.num_doubled > DOUBLED * num_with_boxes:
        what = (
            f"{seen.num_doubled} of {num_with_boxes} messages have boxes of one label that overlap by more than"
            f" {LARGEST_OVERLAP:g} (intersection over union): each becomes an object"
        )
        yield warning(NAME, what, "turn on non-maximum suppression (NMS) in the detector")


def _not_finite(faulty: Flags) -> Iterator[Finding]:
    """``faulty``: (N,) whether each detection needs a finite box and has none."""
    if not faulty.any() or faulty.mean() <= SOME:
        return
    severity = Severity.ERROR if faulty.mean() > MOST else Severity.WARNING
    what = f"{_count(faulty)} boxes are not finite, and their detections are not used"
    yield Finding(severity, NAME, what, "give x_min y_min x_max y_max in pixels, and no detection without a box")


def _in_picture(boxes: Array, width: int, height: int) -> Iterator[Finding]:
    size = np.array([width, height], dtype=np.float64)
    beyond = np.asarray(((boxes[:, 2:] > (1.0 + BEYOND) * size) | (boxes[:, :2] < -BEYOND * size)).any(axis=1))
    reach = boxes[:, 2:].max(axis=0)
    what = f"the picture has {width} x {height} pixels, and boxes reach to {reach[0]:.0f} x {reach[1]:.0f}"
    remedy = "scale the boxes to the picture that camera_info describes; the detector saw another size"
    if beyond.mean() > SOME:
        severity = Severity.ERROR if beyond.mean() > MOST else Severity.WARNING
        yield Finding(severity, NAME, f"{_count(beyond)} boxes reach outside: {what}", remedy)
    elif len(boxes) >= LEAST_BOXES and (reach < CORNER * size).all():
        yield warning(NAME, f"all {len(boxes)} boxes lie in the upper left corner: {what} at most", remedy)


def _count(rows: Flags) -> str:
    return f"{int(rows.sum())} of {len(rows)}"

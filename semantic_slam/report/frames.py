"""Camera pictures with the boxes of their detections, and what they were taken for."""

import base64
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.errors import InputError
from semantic_slam.evaluation.history import UNKNOWN, associated_objects, best_index
from semantic_slam.messages import topics
from semantic_slam.messages.images import decode_image
from semantic_slam.messages.standard import header_stamp_ns
from semantic_slam.messages.typestore import deserialize
from semantic_slam.report.document import Analysis

SHOWN_FRAMES = 12
WIDTH = 480
JPEG_QUALITY = 78


@dataclass(frozen=True)
class BoxView:
    """One detection; edges in per cent of the picture."""

    left: float
    top: float
    width: float
    height: float
    text: str
    colour: str
    verdict: str  # right, wrong or unknown

    @property
    def places(self) -> str:
        """CSS classes that keep the text inside the picture."""
        inside = "inside " if self.top + self.height > 93.0 else ""
        return inside + ("leftwards" if self.left > 72.0 else "")


@dataclass(frozen=True)
class FrameView:
    """One keyframe's picture."""

    keyframe: int
    data: str  # base64 of a JPEG
    width: int
    height: int
    boxes: list[BoxView]


def frame_views(analysis: Analysis, source_bag: Path | None, colours: list[str]) -> tuple[list[FrameView], str]:
    """A dozen keyframes with detections, spread over the run; and why there are none, "" when there are some."""
    if source_bag is None or not source_bag.exists():
        return [], "The bag with the pictures is not there any more."
    chosen = _chosen(analysis)
    try:
        pictures = _pictures(source_bag, {analysis.record.beliefs[row].stamp_ns for row in chosen})
    except InputError as fault:
        return [], f"The pictures cannot be read: {fault}"
    views = [
        _view(analysis, row, pictures[stamp], colours) for row, stamp in _stamped(analysis, chosen) if stamp in pictures
    ]
    return views, "" if views else "The bag holds no picture taken at these keyframes."


def _stamped(analysis: Analysis, rows: list[int]) -> list[tuple[int, int]]:
    return [(row, analysis.record.beliefs[row].stamp_ns) for row in rows]


def _chosen(analysis: Analysis) -> list[int]:
    beliefs, measured = analysis.record.beliefs, analysis.record.measurements
    rows = [row for row, belief in enumerate(beliefs) if len(belief.detection_ids) and belief.stamp_ns in measured]
    places = {round(place) for place in np.linspace(0, len(rows) - 1, SHOWN_FRAMES)} if rows else set()
    return [rows[place] for place in sorted(places)]


def _pictures(bag: Path, stamps: set[int]) -> dict[int, NDArray[np.uint8]]:
    """RGB pictures with these stamps; a damaged end of the bag, or a picture, costs only what it held."""
    found: dict[int, NDArray[np.uint8]] = {}
    with BagReader(bag) as reader, suppress(TruncatedBagError):
        for message in reader.messages((topics.IMAGE_COMPRESSED, topics.IMAGE)):
            image = deserialize(message.cdr, message.type_name)
            if header_stamp_ns(image) in stamps:
                with suppress(InputError):
                    found[header_stamp_ns(image)] = decode_image(image, message.topic)
    return found


def _view(analysis: Analysis, row: int, picture: NDArray[np.uint8], colours: list[str]) -> FrameView:
    height, width = picture.shape[:2]
    scale = min(1.0, WIDTH / width)
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else picture
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return FrameView(
        keyframe=analysis.record.beliefs[row].keyframe,
        data=base64.b64encode(encoded.tobytes()).decode("ascii"),
        width=small.shape[1],
        height=small.shape[0],
        boxes=_boxes(analysis, row, width, height, colours),
    )


def _boxes(analysis: Analysis, row: int, width: int, height: int, colours: list[str]) -> list[BoxView]:
    belief = analysis.record.beliefs[row]
    measured = analysis.record.measurements[belief.stamp_ns]
    places = {int(number): place for place, number in enumerate(measured.detection_ids)}
    best = best_index(belief)
    objects = associated_objects(belief)[best]
    views = []
    for detection, number in enumerate(belief.detection_ids):
        if int(number) in places:
            box = np.clip(measured.boxes[places[int(number)]], 0, [width, height, width, height])
            text, colour = _text(analysis, row, int(belief.associations[best, detection]), colours)
            verdict, note = _verdict(analysis, row, detection, int(objects[detection]))
            left, top, right, bottom = (100.0 * box / np.array([width, height, width, height])).round(2).tolist()
            views.append(BoxView(left, top, right - left, bottom - top, text + note, colour, verdict))
    return views


def _text(analysis: Analysis, row: int, place: int, colours: list[str]) -> tuple[str, str]:
    """``object class probability`` as believed at that keyframe, and the colour of the class."""
    belief = analysis.record.beliefs[row]
    if place < 0:
        return "clutter", "#5b6b7a"
    probabilities = belief.class_probabilities[place]
    if not probabilities.size:
        return str(belief.object_ids[place]), "#5b6b7a"
    best = int(np.argmax(probabilities))
    return f"{belief.object_ids[place]} {belief.class_names[best]} {probabilities[best]:.2f}", colours[best]


def _verdict(analysis: Analysis, row: int, detection: int, found: int) -> tuple[str, str]:
    if analysis.evaluation is None:
        return "unknown", ""
    true = int(analysis.evaluation.true_associations[row][detection])
    if true == UNKNOWN:
        return "unknown", ""
    if true == found:
        return "right", ""
    return "wrong", f" (is {true})" if true >= 0 else " (is not on the map)" if true < -1 else " (is clutter)"

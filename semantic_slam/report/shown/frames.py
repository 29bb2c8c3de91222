"""Camera images in the report: selected keyframes, slider images, and a crop of each object."""

import base64
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.images import decode_image
from semantic_slam.messages.standard import header_stamp_ns
from semantic_slam.messages.typestore import deserialize
from semantic_slam.report.document import Analysis
from semantic_slam.report.shown.boxes import BoxView, box_views
from semantic_slam.report.shown.crops import MARGIN, BestView, best_views

Picture = NDArray[np.uint8]
SHOWN_FRAMES = 12
SLIDER_FRAMES = 150
"""Keyframes at most whose pictures go with the slider, which shows the newest of them."""
WIDTH, SLIDER_WIDTH, CROP_SIDE = 480, 340, 128
"""Pixels; of a crop, its longer side."""
JPEG_QUALITY = 78


@dataclass(frozen=True)
class FrameView:
    """One keyframe's picture."""

    keyframe: int
    data: str  # base64 of a JPEG
    width: int
    height: int
    boxes: list[BoxView]


@dataclass(frozen=True)
class CropView:
    """What one object looks like."""

    data: str  # base64 of a JPEG
    text: str


@dataclass
class Pictures:
    """Everything in a report that comes from the camera."""

    frames: list[FrameView] = field(default_factory=list)
    slider: dict[int, FrameView] = field(default_factory=dict)  # by the belief's place
    crops: dict[int, CropView] = field(default_factory=dict)  # by object id
    views: dict[tuple[int, int], CropView] = field(default_factory=dict)  # by object id and the belief's place
    why_none: str = ""


def picture_views(
    analysis: Analysis, source_bag: Path | None, colours: list[str], views: Sequence[BestView] = ()
) -> Pictures:
    """A dozen keyframes with detections, spread over the run, pictures for the slider and crops; or why there are none.

    Each picture is read once, and forgotten. ``views``: more crops that are wanted.
    """
    if source_bag is None or not source_bag.exists():
        return Pictures(why_none="The bag with the pictures is not there any more.")
    stamps = [belief.stamp_ns for belief in analysis.record.beliefs]
    large, small = set(_chosen(analysis)), set(_spread(list(range(len(stamps))), SLIDER_FRAMES))
    crops: dict[int, list[BestView]] = {}
    for view in best_views(analysis):
        crops.setdefault(view.row, []).append(view)
    more: dict[int, list[BestView]] = {}
    for view in views:
        more.setdefault(view.row, []).append(view)
    wanted = {stamps[row]: row for row in sorted(large | small | set(crops) | set(more))}
    found = Pictures()
    try:
        for stamp, picture in _pictures(source_bag, set(wanted)):
            row = wanted[stamp]
            if row in large:
                found.frames.append(_view(analysis, row, picture, WIDTH, colours))
            if row in small:
                found.slider[row] = _view(analysis, row, picture, SLIDER_WIDTH, colours)
            found.crops.update((own.object_id, crop) for own in crops.get(row, []) if (crop := _crop(picture, own)))
            found.views.update(
                ((own.object_id, row), crop) for own in more.get(row, []) if (crop := _crop(picture, own))
            )
    except InputError as fault:
        return Pictures(why_none=f"The pictures cannot be read: {fault}")
    found.frames.sort(key=lambda view: view.keyframe)
    found.why_none = "" if found.frames else "The bag holds no picture taken at these keyframes."
    return found


def _chosen(analysis: Analysis) -> list[int]:
    beliefs, measured = analysis.record.beliefs, analysis.record.measurements
    rows = [row for row, belief in enumerate(beliefs) if len(belief.detection_ids) and belief.stamp_ns in measured]
    return _spread(rows, SHOWN_FRAMES)


def _spread(rows: list[int], count: int) -> list[int]:
    """At most so many, evenly spread, the last among them."""
    places = {round(place) for place in np.linspace(0, len(rows) - 1, min(count, len(rows)))} if rows else set()
    return [rows[place] for place in sorted(places)]


def _pictures(bag: Path, stamps: set[int]) -> Iterator[tuple[int, Picture]]:
    """RGB pictures with these stamps; a damaged end of the bag, or a picture, costs only what it held."""
    with BagReader(bag) as reader, suppress(TruncatedBagError):
        for message in reader.messages((topics.IMAGE_COMPRESSED, topics.IMAGE)):
            image = deserialize(message.cdr, message.type_name)
            stamp = header_stamp_ns(image)
            if stamp in stamps:
                with suppress(InputError):
                    picture = decode_image(image, message.topic)
                    stamps.discard(stamp)
                    yield stamp, picture


def _view(analysis: Analysis, row: int, picture: Picture, width: int, colours: list[str]) -> FrameView:
    small = scaled(picture, min(1.0, width / picture.shape[1]))
    return FrameView(
        keyframe=analysis.record.beliefs[row].keyframe,
        data=base64_jpeg(small),
        width=small.shape[1],
        height=small.shape[0],
        boxes=box_views(analysis, row, (picture.shape[1], picture.shape[0]), colours),
    )


def _crop(picture: Picture, view: BestView) -> CropView | None:
    """None where the box shows nothing of the picture."""
    left, top, right, bottom = _edges(view.box, picture.shape[1], picture.shape[0])
    if right - left < 2 or bottom - top < 2:
        return None
    part = picture[top:bottom, left:right]
    return CropView(data=base64_jpeg(scaled(part, min(1.0, CROP_SIDE / max(part.shape[:2])))), text=view.text)


def _edges(box: Array, width: int, height: int) -> list[int]:
    """Left, top, right, bottom of a box with its margin, inside the picture."""
    around = MARGIN * np.tile(box[2:] - box[:2], 2) * [-1.0, -1.0, 1.0, 1.0]
    edges: list[int] = np.clip(np.round(box + around), 0, [width, height] * 2).astype(int).tolist()
    return edges


def scaled(picture: Picture, scale: float) -> Picture:
    """A picture made smaller; never larger."""
    if scale >= 1.0:
        return picture
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def base64_jpeg(picture: Picture) -> str:
    """Base64 of the JPEG of an RGB picture."""
    return base64.b64encode(jpeg(picture)).decode("ascii")


def jpeg(picture: Picture) -> bytes:
    """A JPEG of an RGB picture."""
    _, encoded = cv2.imencode(
        ".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    )
    return bytes(encoded.tobytes())

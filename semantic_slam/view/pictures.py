"""Pictures of the newest keyframes with their boxes; scaled and encoded when somebody looks at them."""

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Any, Generic, TypeVar

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.images import decode_image, size_of
from semantic_slam.messages.standard import header_stamp_ns
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.report.rendering import shown_picture
from semantic_slam.report.shown.boxes import boxes_of
from semantic_slam.report.shown.frames import jpeg, scaled

WIDTH = 560
"""Pixels."""
KEPT_PICTURES, KEPT_BYTES = 150, 48_000_000
WAITING, WAITING_BELIEFS = 256, 16
"""What is kept of pictures and measurements, and of beliefs, that the others of their instant have not come to yet."""

T = TypeVar("T")


class Newest(OrderedDict[int, T], Generic[T]):
    """The newest of what came, by number."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self._most = most

    def keep(self, number: int, item: T) -> None:
        self[number] = item
        self.move_to_end(number)
        while len(self) > self._most:
            self.popitem(last=False)


@dataclass
class Picture:
    """One keyframe's picture."""

    version: int
    message: Any  # sensor_msgs Image or CompressedImage
    entry: dict[str, Any]  # what the page's script shows

    @cached_property
    def jpeg(self) -> bytes:
        """The picture as it is sent to browsers. Raises MessageError where it does not decode."""
        pixels = decode_image(self.message, "image")
        return jpeg(scaled(pixels, min(1.0, WIDTH / pixels.shape[1])))


class Pictures:
    """Puts together what belongs to one instant, in whatever order it comes."""

    def __init__(self) -> None:
        self.shown: Newest[Picture] = Newest(KEPT_PICTURES)  # by keyframe
        self._messages: Newest[Any] = Newest(WAITING)
        self._measured: Newest[SemanticMeasurements] = Newest(WAITING)
        self._beliefs: Newest[tuple[HybridBelief, list[str]]] = Newest(WAITING_BELIEFS)

    def forget_run(self) -> None:
        """Drop what belongs to the beliefs so far; what came early for the next run stays."""
        self.shown.clear()
        self._beliefs.clear()

    def add_picture(self, message: Any, version: int, folder: str) -> None:
        self._messages.keep(header_stamp_ns(message), message)
        self._bound(self._messages, lambda waiting: len(waiting.data))
        self._complete(header_stamp_ns(message), version, folder)

    def add_measurements(self, measured: SemanticMeasurements, version: int, folder: str) -> None:
        self._measured.keep(measured.stamp_ns, measured)
        self._complete(measured.stamp_ns, version, folder)

    def add_belief(self, belief: HybridBelief, colours: list[str], version: int, folder: str) -> None:
        self._beliefs.keep(belief.stamp_ns, (belief, colours))
        self._complete(belief.stamp_ns, version, folder)

    def changed_since(self, version: int) -> list[dict[str, Any]]:
        return [picture.entry for picture in self.shown.values() if picture.version > version]

    def _complete(self, stamp_ns: int, version: int, folder: str) -> None:
        """Show the keyframe of this instant, once all of it has come; ``folder`` is where its address lies."""
        message, (belief, colours) = self._messages.get(stamp_ns), self._beliefs.get(stamp_ns, (None, []))
        measured = self._measured.get(stamp_ns)
        if message is None or belief is None or (measured is None and len(belief.detection_ids)):
            return
        del self._messages[stamp_ns], self._beliefs[stamp_ns]
        size = size_of(message)
        if size is None or 0 in size:
            return
        boxes = boxes_of(belief, measured, size, colours) if measured is not None else []
        drawable = [box for box in boxes if isfinite(box.left + box.top + box.width + box.height)]
        scale = min(1.0, WIDTH / size[0])
        smaller = max(1, round(scale * size[0])), max(1, round(scale * size[1]))
        entry = shown_picture(belief.keyframe, f"{folder}/{belief.keyframe}.jpg", smaller, drawable)
        self.shown.keep(belief.keyframe, Picture(version, message, entry))
        self._bound(self.shown, lambda picture: len(picture.message.data))

    @staticmethod
    def _bound(items: "Newest[Any]", size: Any) -> None:
        """Drop the oldest until no more than KEPT_BYTES are left, but never the newest."""
        total = sum(size(item) for item in items.values())
        while total > KEPT_BYTES and len(items) > 1:
            total -= size(items.popitem(last=False)[1])

"""NanoDet object detector from an ONNX file, run by OpenCV: boxes with a score for every class."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from semantic_slam.errors import InputError, one_line
from semantic_slam.geometry.arrays import Array, Bytes, Index
from semantic_slam.perception.frame import Detections
from semantic_slam.text_files import read_text

MEAN_BGR = (103.53, 116.28, 123.675)
SCALE_BGR = (57.375, 57.12, 58.395)
"""Channel scales (BGR) of NanoDet's input normalisation: (pixel - mean) / scale."""
EDGES = 4
"""Number of regressed distances per box: left, top, right and bottom edge from the cell centre."""


@dataclass(frozen=True, kw_only=True)
class DetectorSettings:
    """Input size and reporting thresholds of the detector."""

    input_size: int = 416  # pixels, side of the square network input; given by the file, 320 or 416
    least_score: float = 0.35  # of a box's best class
    largest_overlap: float = 0.6  # intersection over union above which the weaker of two boxes is suppressed


@dataclass(frozen=True)
class Letterbox:
    """Image scaled into the centre of a square: square pixel = scale * image pixel + (left, top)."""

    square: Bytes  # (size, size, 3), black outside the image
    scale: float
    left: int
    top: int

    def to_picture(self, boxes: Array) -> Array:
        """Convert (N, 4) boxes from square to image pixels."""
        return np.asarray((boxes - np.tile([self.left, self.top], 2)) / self.scale)


class OnnxDetector:
    """Object detector that runs a network with NanoDet's output layout."""

    def __init__(self, path: Path, class_names: Sequence[str], settings: DetectorSettings | None = None) -> None:
        """Load the network. Raises InputError when OpenCV cannot read ``path``."""
        self.class_names, self.settings, self._path = tuple(class_names), settings or DetectorSettings(), path
        if not path.is_file():
            raise InputError(f"{path}: no such file; name the detector's ONNX file")
        try:
            self._network = cv2.dnn.readNetFromONNX(str(path))
        except cv2.error as fault:
            raise InputError(
                f"{path}: no ONNX network that OpenCV reads ({one_line(fault, 200)}); export it anew"
            ) from None

    def __call__(self, image: Bytes, *, stamp_ns: int, frame_id: str) -> Detections:
        """Detect objects in an (H, W, 3) RGB image: boxes in its pixels, each with the scores of all classes.

        Overlapping boxes become one detection whatever their classes (class-agnostic suppression). Raises InputError
        when the outputs do not have NanoDet's layout, or have another number of classes.
        """
        height, width = image.shape[:2]
        letterbox = letterboxed(image, self.settings.input_size)
        boxes, scores = nanodet_boxes(
            self._outputs(letterbox.square), len(self.class_names), self.settings, str(self._path)
        )
        boxes = np.clip(letterbox.to_picture(boxes), 0.0, np.tile([width, height], 2))
        kept = without_overlaps(boxes, scores.max(axis=1, initial=0.0), self.settings.largest_overlap)
        boxes, scores = boxes[kept], scores[kept]
        return Detections(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            boxes=boxes,
            labels=tuple(self.class_names[best] for best in scores.argmax(axis=1)) if len(kept) else (),
            scores=scores.max(axis=1, initial=0.0),
            track_ids=("",) * len(kept),
            class_names=self.class_names,
            class_scores=scores,
        )

    def _outputs(self, square: Bytes) -> list[Array]:
        values = np.asarray((square[..., ::-1] - np.array(MEAN_BGR)) / np.array(SCALE_BGR), dtype=np.float32)
        try:
            self._network.setInput(cv2.dnn.blobFromImage(values))
            outputs = self._network.forward(self._network.getUnconnectedOutLayersNames())
        except cv2.error as fault:
            size = self.settings.input_size
            raise InputError(
                f"{self._path}: does not run on {size} x {size} pixels ({one_line(fault, 200)}); give its own input"
                " size"
            ) from None
        return [np.asarray(output, dtype=np.float64) for output in outputs]


def read_class_names(path: Path) -> tuple[str, ...]:
    """Read the class names of a detector, one per line, as in coco.names. Raises InputError."""
    remedy = "give a text file with one class name a line"
    names = tuple(line.strip() for line in read_text(path, remedy).splitlines() if line.strip())
    if not names or len(set(names)) != len(names):
        raise InputError(f"{path}: {'no class' if not names else 'a class is named twice'}; {remedy}")
    return names


def letterboxed(image: Bytes, size: int) -> Letterbox:
    """Letterbox an (H, W, 3) image into a black (size, size, 3) square, aspect ratio kept."""
    height, width = image.shape[:2]
    scale = size / max(height, width)
    inner = (max(round(width * scale), 1), max(round(height * scale), 1))
    left, top = (size - inner[0]) // 2, (size - inner[1]) // 2
    square = np.zeros((size, size, 3), dtype=np.uint8)
    square[top : top + inner[1], left : left + inner[0]] = cv2.resize(image, inner, interpolation=cv2.INTER_LINEAR)
    return Letterbox(square, scale, left, top)


def nanodet_boxes(
    outputs: Sequence[Array], num_classes: int, settings: DetectorSettings, origin: str
) -> tuple[Array, Array]:
    """Decode NanoDet outputs: (N, 4) boxes in square pixels and (N, C) scores of cells above the least score.

    Each grid has two outputs: (1, cells, C) scores, and (1, cells, 4 B) logits of each edge's distance. The distance is
    the mean over the bins 0 .. B - 1, in cells (generalized focal loss, Li et al. 2020, Eq. 5). Raises InputError.
    """
    boxes, scores = [np.zeros((0, EDGES))], [np.zeros((0, num_classes))]
    for cell_scores, distances in _grids(outputs, num_classes, origin):
        side = round(len(cell_scores) ** 0.5)
        cells = np.flatnonzero(cell_scores.max(axis=1) >= settings.least_score)
        pixels = settings.input_size / side
        centre = (np.stack([cells % side, cells // side], axis=1) + 0.5) * pixels
        reach = _mean_bins(distances[cells]) * pixels
        boxes.append(np.concatenate([centre - reach[:, :2], centre + reach[:, 2:]], axis=1))
        scores.append(cell_scores[cells])
    return np.concatenate(boxes), np.concatenate(scores)


def without_overlaps(boxes: Array, scores: Array, largest_overlap: float) -> Index:
    """Non-maximum suppression: rows of (N, 4) boxes that overlap no better one by more than that IoU, best first."""
    area = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1)
    left = np.argsort(-scores, kind="stable")
    left, kept = left[area[left] > 0.0], []
    while len(left):
        best, rest = left[0], left[1:]
        kept.append(best)
        shared = np.minimum(boxes[best, 2:], boxes[rest, 2:]) - np.maximum(boxes[best, :2], boxes[rest, :2])
        both = np.prod(np.maximum(shared, 0.0), axis=1)
        left = rest[both <= largest_overlap * (area[best] + area[rest] - both)]
    return np.array(kept, dtype=np.intp)


def _grids(outputs: Sequence[Array], num_classes: int, origin: str) -> list[tuple[Array, Array]]:
    """(cells, C) scores and (cells, 4, B) logits of every grid. Raises InputError."""
    rows = [output[0] for output in outputs if output.ndim == 3 and len(output) == 1]
    paired = len(rows) // 2
    found = list(zip(rows[:paired], rows[paired:], strict=False))
    for scores, logits in found:
        if scores.shape[1] != num_classes:
            raise InputError(f"{origin}: tells {scores.shape[1]} classes, not {num_classes}; give its own class names")
        if len(scores) != len(logits) or logits.shape[1] % EDGES or round(len(scores) ** 0.5) ** 2 != len(scores):
            found = []
            break
    if not found or len(rows) != len(outputs) or len(rows) % 2:
        shapes = ", ".join(str(output.shape) for output in outputs)
        raise InputError(f"{origin}: outputs of shapes {shapes} are not NanoDet's; give a NanoDet file")
    return [(scores, logits.reshape(len(logits), EDGES, -1)) for scores, logits in found]


def _mean_bins(logits: Array) -> Array:
    """(N, 4) expected bin numbers under the softmax of (N, 4, B) logits."""
    weights = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return np.asarray(weights @ np.arange(logits.shape[-1]) / weights.sum(axis=-1))

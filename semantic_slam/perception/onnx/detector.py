"""Object detector from an ONNX file, run by OpenCV: boxes with a score for every class."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from semantic_slam.errors import InputError, one_line
from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.crops import are_in_shares
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.onnx.declared_inputs import declared_inputs, stated_class_names, stated_input_size
from semantic_slam.perception.onnx.letterbox import letterboxed
from semantic_slam.perception.onnx.recognition import recognised
from semantic_slam.perception.onnx.suppression import without_overlaps
from semantic_slam.text_files import read_text

SCORE_TOLERANCE = 0.01
"""How far beyond 0 and 1 the rounding of a quantised network takes a score."""


@dataclass(frozen=True, kw_only=True)
class DetectorSettings:
    """What a detector's file may leave open, and its reporting thresholds."""

    input_size: int | None = None  # pixels, side of the square input; None: as the file says
    layout: str | None = None  # of recognition.TABLES; None: by the shapes of the outputs
    least_score: float = 0.35  # of a box's best class
    largest_overlap: float = 0.6  # intersection over union above which the weaker of two boxes is suppressed


class OnnxDetector:
    """Object detector that runs a network of NanoDet's or of one of YOLO's layouts."""

    def __init__(self, path: Path, class_names: Sequence[str], settings: DetectorSettings | None = None) -> None:
        """Load the network and run it once, on a blank picture, to see which layout its outputs have.

        Raises InputError when OpenCV cannot read or run ``path``, when its input size is open and not given, and for
        outputs of another layout, and for class names that are not as many as it has, or in another order.
        """
        self.class_names, self.settings, self._path = tuple(class_names), settings or DetectorSettings(), path
        self._network = _network(path)
        _check_names(self.class_names, stated_class_names(path), path)
        self.input_size = _input_size(path, self.settings.input_size)  # height and width
        outputs = self._outputs(np.zeros((*self.input_size, 3)))
        self._layout = recognised(outputs, len(self.class_names), self.input_size, self.settings.layout, path)
        self._boxes(outputs)

    def __call__(self, image: Bytes, *, stamp_ns: int, frame_id: str) -> Detections:
        """Detect objects in an (H, W, 3) RGB image: boxes in its pixels, each with the scores of all classes.

        Overlapping boxes become one detection whatever their classes (class-agnostic suppression). Raises InputError
        when the numbers are not of the network's layout.
        """
        height, width = image.shape[:2]
        letterbox = letterboxed(image, self.input_size, self._layout.grey)
        boxes, scores = self._boxes(self._outputs(self._layout.normalised(letterbox.pixels)))
        told = np.nan_to_num(scores, nan=0.0)
        best = told.max(axis=1, initial=0.0)
        rows = np.flatnonzero(best >= self.settings.least_score)
        boxes = np.clip(letterbox.to_picture(boxes[rows]), 0.0, np.tile([width, height], 2))
        kept = without_overlaps(boxes, best[rows], self.settings.largest_overlap)
        rows = rows[kept]
        return Detections(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            boxes=boxes[kept],
            labels=tuple(self.class_names[number] for number in told[rows].argmax(axis=1)),
            scores=best[rows],
            track_ids=("",) * len(rows),
            class_names=self.class_names,
            class_scores=scores[rows],
        )

    def _outputs(self, channels: Array) -> list[Array]:
        """Outputs of the network for the (H, W, 3) channels of its input. Raises InputError."""
        try:
            self._network.setInput(cv2.dnn.blobFromImage(np.asarray(channels, dtype=np.float32)))
            outputs = self._network.forward(self._network.getUnconnectedOutLayersNames())
        except cv2.error as fault:
            height, width = self.input_size
            raise InputError(
                f"{self._path}: does not run on {width} x {height} pixels ({one_line(fault, 200)}); give its own input"
                " size"
            ) from None
        return [np.asarray(output, dtype=np.float64) for output in outputs]

    def _boxes(self, outputs: Sequence[Array]) -> tuple[Array, Array]:
        """(N, 4) boxes in pixels of the input and (N, C) scores, NaN where not reported. Raises InputError."""
        num_classes, least = len(self.class_names), self.settings.least_score
        try:
            boxes, scores = self._layout.boxes(outputs)
            if (scores[:, num_classes:] >= least).any():
                raise ValueError(f"it reports a class whose number is none of the {num_classes} named ones")
        except ValueError as fault:
            raise InputError(
                f"{self._path}: {fault}; give its own class names, or export it in a layout of docs/own_bag.md"
            ) from None
        _check_scores(scores, self._path)
        _check_unit(boxes[(scores >= least).any(axis=1)], self._path)
        return boxes, np.clip(scores[:, :num_classes], 0.0, 1.0)


def read_class_names(path: Path) -> tuple[str, ...]:
    """Read the class names of a detector, one per line, as in coco.names. Raises InputError."""
    remedy = "give a text file with one class name a line"
    names = tuple(line.strip() for line in read_text(path, remedy).splitlines() if line.strip())
    if not names or len(set(names)) != len(names):
        raise InputError(f"{path}: {'no class' if not names else 'a class is named twice'}; {remedy}")
    return names


def _check_names(given: Sequence[str], stated: Sequence[str], path: Path) -> None:
    """Raise InputError where a file states other classes; names may be others, such as those of another language."""
    if stated and len(stated) != len(given):
        raise InputError(f"{path}: states {len(stated)} classes, and {len(given)} are named; give its own class names")
    if set(stated) == set(given) and list(stated) != list(given):
        raise InputError(f"{path}: states the same classes in another order; give the class names in its order")


def _check_scores(scores: Array, path: Path) -> None:
    """Raise InputError for logits, as an export without its last activation has them; NaN: not reported."""
    low, high = np.nanmin(scores, initial=0.0), np.nanmax(scores, initial=1.0)
    if low < -SCORE_TOLERANCE or high > 1.0 + SCORE_TOLERANCE:
        raise InputError(
            f"{path}: scores from {low:.3g} to {high:.3g} are not between 0 and 1; apply a sigmoid in the export"
        )


def _check_unit(boxes: Array, path: Path) -> None:
    """Raise InputError for (N, 4) boxes in shares of the input; rows without an area only fill a table up."""
    areas = boxes[(boxes[:, 2:] > boxes[:, :2]).all(axis=1)]
    if len(areas) and are_in_shares(areas).all():
        raise InputError(
            f"{path}: the boxes are in shares of the input, not in its pixels; export it with boxes in pixels"
        )


def _network(path: Path) -> cv2.dnn.Net:
    """Network of a file. Raises InputError."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; name the detector's ONNX file")
    try:
        return cv2.dnn.readNetFromONNX(str(path))
    except cv2.error as fault:
        raise InputError(
            f"{path}: no ONNX network that OpenCV reads ({one_line(fault, 200)}); export it anew"
        ) from None


def _input_size(path: Path, given: int | None) -> tuple[int, int]:
    """Height and width of the input, from the file; where it leaves them open, as given. Raises InputError."""
    inputs = list(declared_inputs(path).values())
    if len(inputs) != 1 or len(inputs[0]) != 4 or inputs[0][1] not in (3, None):
        shapes = ", ".join("x".join(str(size or "?") for size in shape) for shape in inputs) or "none"
        raise InputError(f"{path}: its inputs are {shapes}; export it with one, pictures of 1x3xHxW")
    height, width = inputs[0][2:]
    if height is None or width is None:
        stated = stated_input_size(path) if given is None else (given, given)
        height, width = height or stated[0], width or stated[1]
    if height is None or width is None:
        raise InputError(f"{path}: leaves its input size open; give it (--input-size, such as 640)")
    if given is not None and given < 1:
        raise InputError(f"--input-size {given}: must be at least 1 pixel")
    if given is not None and given not in (height, width):
        raise InputError(f"{path}: its input is {width} x {height} pixels, not {given}; leave the input size out")
    return height, width

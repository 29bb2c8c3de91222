"""NanoDet's layout: outputs by hand, and the pictures of a real kitchen."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from semantic_slam.perception.onnx.detector import OnnxDetector, read_class_names
from semantic_slam.perception.onnx.nanodet import NanoDet

SIZE = (64, 64)
NUM_CLASSES, BINS = 3, 8


def outputs_of(cell: tuple[int, int], reach: tuple[int, int, int, int], scores: list[float]) -> list[np.ndarray]:
    """Of a network that sees one object, from the cell (x, y) of its finest grid, its edges ``reach`` cells away."""
    sides = (8, 4, 2)
    told = [np.zeros((1, side * side, NUM_CLASSES)) for side in sides]
    edges = [np.zeros((1, side * side, 4 * BINS)) for side in sides]
    row = cell[1] * sides[0] + cell[0]
    told[0][0, row] = scores
    edges[0][0, row, np.arange(4) * BINS + np.array(reach)] = 1000.0
    return told + edges


def test_a_box_reaches_from_its_cells_centre_as_far_as_the_likeliest_bins_tell() -> None:
    """The cell (3, 2) of 8 pixels has its centre at (28, 20); edges 1, 2, 3 and 0 cells to all sides."""
    outputs = outputs_of((3, 2), (1, 2, 3, 0), [0.1, 0.6, 0.4])
    layout = NanoDet.of(outputs, NUM_CLASSES, SIZE)
    assert layout is not None
    boxes, scores = layout.boxes(outputs)
    (seen,) = np.flatnonzero(scores.any(axis=1))
    assert boxes[seen] == pytest.approx([20.0, 4.0, 52.0, 20.0])
    assert scores[seen] == pytest.approx([0.1, 0.6, 0.4])


def test_a_wide_input_has_grids_of_square_cells() -> None:
    """Cell number 17 of 16 x 4 cells of 8 pixels is the second of the second row: its centre is at (12, 12)."""
    outputs = [np.zeros((1, 64, NUM_CLASSES)), np.zeros((1, 64, 4 * BINS))]
    outputs[1][0, 17, np.arange(4) * BINS + 1] = 1000.0
    layout = NanoDet.of(outputs, NUM_CLASSES, (32, 128))
    assert layout is not None
    assert layout.boxes(outputs)[0][17] == pytest.approx([4.0, 4.0, 20.0, 20.0])


@pytest.mark.parametrize(
    "outputs",
    [
        outputs_of((0, 0), (1, 1, 1, 1), [1.0, 0.0, 0.0])[:5],  # a grid without distances
        [np.zeros((1, 64, NUM_CLASSES + 1)), np.zeros((1, 64, 32))],  # another number of classes
        [np.zeros((1, 60, NUM_CLASSES)), np.zeros((1, 60, 32))],  # no grid of a square
        [np.zeros((1, 64, NUM_CLASSES)), np.zeros((1, 64, 30))],  # not four edges
    ],
)
def test_outputs_of_another_layout_are_not_taken_for_nanodets(outputs: list[np.ndarray]) -> None:
    assert NanoDet.of(outputs, NUM_CLASSES, SIZE) is None


@pytest.mark.real_data
def test_nanodet_sees_chair_cup_and_table_of_a_real_kitchen(data_set: Callable[[str], Path]) -> None:
    weights = data_set("weights")
    detector = OnnxDetector(weights / "nanodet_m.onnx", read_class_names(weights / "coco.names"))
    assert detector.input_size == (416, 416)
    image = cv2.imread(str(data_set("redkitchen") / "frame-000000.color.jpg"))[..., ::-1]
    found = detector(image, stamp_ns=3, frame_id="camera")
    assert {"chair", "cup", "diningtable"} <= set(found.labels)
    assert found.class_scores.shape == (len(found), 80)
    cup = found.boxes[found.labels.index("cup")]
    assert (cup[0] < 385.0 < cup[2]) and (cup[1] < 183.0 < cup[3])  # the mug on the table, by eye

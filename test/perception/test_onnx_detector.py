"""A NanoDet detector: its outputs by hand, and the pictures of a real kitchen."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.perception.onnx_detector import (
    DetectorSettings,
    OnnxDetector,
    letterboxed,
    nanodet_boxes,
    read_class_names,
    without_overlaps,
)

SETTINGS = DetectorSettings(input_size=64)
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
    boxes, scores = nanodet_boxes(outputs_of((3, 2), (1, 2, 3, 0), [0.1, 0.6, 0.4]), NUM_CLASSES, SETTINGS, "net")
    assert boxes == pytest.approx(np.array([[20.0, 4.0, 52.0, 20.0]]))
    assert scores == pytest.approx(np.array([[0.1, 0.6, 0.4]]))


def test_cells_in_which_no_class_scores_enough_tell_nothing() -> None:
    boxes, scores = nanodet_boxes(outputs_of((3, 2), (1, 1, 1, 1), [0.1, 0.3, 0.2]), NUM_CLASSES, SETTINGS, "net")
    assert boxes.shape == (0, 4) and scores.shape == (0, NUM_CLASSES)


def test_outputs_of_another_number_of_classes_are_refused() -> None:
    with pytest.raises(InputError, match="tells 3 classes, not 80"):
        nanodet_boxes(outputs_of((0, 0), (1, 1, 1, 1), [1.0, 0.0, 0.0]), 80, SETTINGS, "net")


def test_outputs_of_another_layout_are_refused() -> None:
    with pytest.raises(InputError, match="not NanoDet's"):
        nanodet_boxes([np.zeros((1, 84, 8400))], 80, SETTINGS, "net")


def test_a_picture_keeps_its_proportions_and_boxes_come_back_from_the_square() -> None:
    image = np.full((48, 128, 3), 255, dtype=np.uint8)
    letterbox = letterboxed(image, 64)
    assert (letterbox.scale, letterbox.left, letterbox.top) == (0.5, 0, 20)
    assert (letterbox.square[20:44] == 255).all() and letterbox.square.sum() == 255 * 64 * 24 * 3
    assert letterbox.to_picture(np.array([[0.0, 20.0, 64.0, 44.0]])).tolist() == [[0.0, 0.0, 128.0, 48.0]]


def test_of_boxes_that_overlap_the_better_one_stays() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [0.0, 0.0, 10.0, 9.0], [5.0, 0.0, 15.0, 10.0], [3.0, 3.0, 3.0, 9.0]])
    assert without_overlaps(boxes, np.array([0.5, 0.6, 0.4, 0.9]), 0.6).tolist() == [1, 2]


def test_files_that_are_no_detectors_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"no network")
    for path in (tmp_path / "net.onnx", tmp_path / "none.onnx"):
        with pytest.raises(InputError, match=path.name) as fault:
            OnnxDetector(path, ("chair",))
        assert "\n" not in str(fault.value)
    (tmp_path / "twice.names").write_text("cup\ncup\n")
    with pytest.raises(InputError, match="named twice"):
        read_class_names(tmp_path / "twice.names")


@pytest.mark.real_data
def test_nanodet_sees_chair_cup_and_table_of_a_real_kitchen(data_set: Callable[[str], Path]) -> None:
    weights = data_set("weights")
    detector = OnnxDetector(weights / "nanodet_m.onnx", read_class_names(weights / "coco.names"))
    image = cv2.imread(str(data_set("redkitchen") / "frame-000000.color.jpg"))[..., ::-1]
    found = detector(image, stamp_ns=3, frame_id="camera")
    assert {"chair", "cup", "diningtable"} <= set(found.labels)
    assert found.class_scores.shape == (len(found), 80)
    cup = found.boxes[found.labels.index("cup")]
    assert (cup[0] < 385.0 < cup[2]) and (cup[1] < 183.0 < cup[3])  # the mug on the table, by eye

"""Detectors of every layout from real ONNX files, whose boxes are known: coloured cells of the picture."""

from pathlib import Path

import numpy as np
import pytest
from worlds.views.onnx_networks import COLOURS, OBJECTNESS, black_with_block, write_network

from semantic_slam.errors import InputError
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.onnx.detector import DetectorSettings, OnnxDetector, read_class_names
from semantic_slam.perception.onnx.layout import Layout
from semantic_slam.perception.onnx.letterbox import letterboxed
from semantic_slam.perception.onnx.nanodet import NanoDet
from semantic_slam.perception.onnx.recognition import recognised
from semantic_slam.perception.onnx.suppression import without_overlaps
from semantic_slam.perception.onnx.yolo import EndToEnd, WithClassScores, WithObjectness

SURE = DetectorSettings(least_score=0.6)
YOLO = ("yolov5", "yolov5_with_grids", "yolov8", "end_to_end")


def detect(detector: OnnxDetector, picture: np.ndarray) -> Detections:
    return detector(picture, stamp_ns=3, frame_id="camera")


@pytest.mark.parametrize("layout", YOLO)
@pytest.mark.parametrize(("number", "colour"), list(enumerate(COLOURS)))
def test_a_block_is_found_where_it_is_and_as_what_it_is(layout: str, number: int, colour: str, tmp_path: Path) -> None:
    """In an input of half the size, 16 pixels below its upper edge, the block is the cell of 16..24 and 24..32 pixels.

    The cell's mean colour is the class's score, so that channels are red, green and blue in 0..1.
    """
    detector = OnnxDetector(write_network(tmp_path / "net.onnx", layout), COLOURS, SURE)
    found = detect(detector, black_with_block((64, 128), (32, 16, 48, 32), colour))
    np.testing.assert_allclose(found.boxes, [[32.0, 16.0, 48.0, 32.0]], atol=1e-4)
    assert (found.stamp_ns, found.frame_id, found.labels, found.class_names) == (3, "camera", (colour,), COLOURS)
    score = OBJECTNESS if layout.startswith("yolov5") else 1.0
    assert found.scores == pytest.approx([score])
    others = np.nan if layout == "end_to_end" else 0.0  # not reported, or seen not to be there
    np.testing.assert_allclose(found.class_scores, [[score if n == number else others for n in range(3)]], atol=1e-6)


@pytest.mark.parametrize("layout", YOLO)
def test_the_file_tells_the_size_of_its_input_also_of_one_that_is_no_square(layout: str, tmp_path: Path) -> None:
    """A picture of 64 x 48 pixels fills 32 rows at 2 / 3 of its size, and stands 11 pixels from the left."""
    detector = OnnxDetector(write_network(tmp_path / "net.onnx", layout, size=(32, 64)), COLOURS, SURE)
    assert detector.input_size == (32, 64)
    letterbox = letterboxed(np.zeros((48, 64, 3), dtype=np.uint8), (32, 64), 114)
    assert (letterbox.left, letterbox.top) == (10, 0) and letterbox.scale == pytest.approx(2 / 3)
    block = letterbox.to_picture(np.array([[24.0, 8.0, 32.0, 16.0]]))  # one of the cells
    found = detect(detector, black_with_block((48, 64), [round(edge) for edge in block[0]], "blue"))
    np.testing.assert_allclose(found.boxes, block, atol=1e-4)


def test_an_input_of_open_size_takes_the_size_that_is_given(tmp_path: Path) -> None:
    path = write_network(tmp_path / "net.onnx", "yolov8", open_sizes=(0, 2, 3))
    with pytest.raises(InputError, match=r"leaves its input size open; give it \(--input-size"):
        OnnxDetector(path, COLOURS)
    detector = OnnxDetector(path, COLOURS, DetectorSettings(input_size=128, least_score=0.6))
    assert detector.input_size == (128, 128)
    found = detect(detector, black_with_block((64, 128), (32, 16, 40, 24), "red"))
    np.testing.assert_allclose(found.boxes, [[32.0, 16.0, 40.0, 24.0]], atol=1e-4)


def test_a_given_size_that_is_not_the_files_is_refused(tmp_path: Path) -> None:
    path = write_network(tmp_path / "net.onnx", "yolov8")
    with pytest.raises(InputError, match="its input is 64 x 64 pixels, not 128"):
        OnnxDetector(path, COLOURS, DetectorSettings(input_size=128))


@pytest.mark.parametrize(
    ("layout", "around"),
    [
        (WithObjectness(3, (64, 64), is_transposed=False), [114 / 255] * 3),
        (WithClassScores(3, (64, 64), is_transposed=True), [114 / 255] * 3),
        (EndToEnd(3, (64, 64), is_transposed=False), [114 / 255] * 3),
        (NanoDet((64, 64)), [-103.53 / 57.375, -116.28 / 57.12, -123.675 / 58.395]),
    ],
)
def test_around_a_picture_the_input_is_grey_for_yolo_and_black_for_nanodet(layout: Layout, around: list[float]) -> None:
    white = np.full((32, 64, 3), 255, dtype=np.uint8)
    channels = layout.normalised(letterboxed(white, (64, 64), layout.grey).pixels)
    np.testing.assert_allclose(channels[[0, 15, 48, 63], ::21], np.tile(around, (4, 4, 1)))
    assert (channels[16:48] > 0.9).all()


def test_nanodets_channels_are_blue_green_and_red(tmp_path: Path) -> None:
    """What the network's first channel, "red" to the YOLOs, sees is blue; its box is two cells wide."""
    detector = OnnxDetector(write_network(tmp_path / "net.onnx", "nanodet"), COLOURS, SURE)
    found = detect(detector, black_with_block((64, 64), (16, 24, 24, 32), "blue"))
    assert found.labels == ("red",)
    np.testing.assert_allclose(found.boxes, [[12.0, 20.0, 28.0, 36.0]], atol=1e-4)


def test_a_table_that_fits_two_layouts_asks_which_it_is(tmp_path: Path) -> None:
    """With one class a row of YOLOv5 has six numbers, as one of an end-to-end network has."""
    path = write_network(tmp_path / "net.onnx", "end_to_end")
    with pytest.raises(InputError, match="may be yolov5 or end_to_end; name the layout"):
        OnnxDetector(path, ("thing",))
    with pytest.raises(InputError, match="class whose number is none of the 1 named ones"):
        detector = OnnxDetector(path, ("thing",), DetectorSettings(layout="end_to_end"))
        detect(detector, black_with_block((64, 64), (16, 24, 24, 32), "blue"))
    with pytest.raises(InputError, match="no layout of a detector"):
        OnnxDetector(path, ("thing",), DetectorSettings(layout="yolov99"))


def test_a_class_without_a_name_matters_where_its_box_counts(tmp_path: Path) -> None:
    """The third class of an end-to-end network, as a table of its best boxes lists it: with any score."""
    path = write_network(tmp_path / "net.onnx", "end_to_end")
    detector = OnnxDetector(path, COLOURS[:2], SURE)
    picture = black_with_block((64, 64), (16, 24, 24, 32), "blue")
    with pytest.raises(InputError, match="a class whose number is none of the 2 named ones; give its own class names"):
        detect(detector, picture)
    assert not len(detect(detector, picture // 2))
    assert detect(detector, black_with_block((64, 64), (16, 24, 24, 32), "red")).labels == ("red",)


def yolox_table(
    box: tuple[float, float, float, float], size: tuple[int, int], cell: tuple[int, int, int]
) -> np.ndarray:
    """Two classes; the cell in that row and column of the grid of that side tells the box, the others nothing."""
    height, width = size
    counts = [height // side * (width // side) for side in (8, 16, 32)]
    table, (row, column, side) = np.zeros((sum(counts), 7)), cell
    number = sum(counts[: (8, 16, 32).index(side)]) + row * (width // side) + column
    centre, extent = np.array([box[0] + box[2], box[1] + box[3]]) / 2.0, np.array([box[2] - box[0], box[3] - box[1]])
    table[number] = [*(centre / side - [column, row]), *np.log(extent / side), 0.8, 0.1, 0.9]
    return table


@pytest.mark.parametrize("cell", [(2, 5, 8), (1, 2, 16), (0, 1, 32)])
def test_boxes_of_a_yolox_are_told_by_its_cells(cell: tuple[int, int, int]) -> None:
    """Its table has the shape of a YOLOv5's, so that its layout has to be named; channels are blue, green and red."""
    box, size = (30.0, 10.0, 70.0, 26.0), (64, 96)
    table = yolox_table(box, size, cell)
    with pytest.raises(ValueError, match=r"not in pixels of the input .*--layout yolox"):
        recognised([table[None]], 2, size, None, Path("net.onnx")).boxes([table[None]])
    layout = recognised([table[None]], 2, size, "yolox", Path("net.onnx"))
    boxes, scores = layout.boxes([table[None]])
    best = int(scores.max(axis=1).argmax())
    np.testing.assert_allclose(boxes[best], box)
    np.testing.assert_allclose(scores[best], [0.08, 0.72])
    decoded = table.copy()
    decoded[:, :2], decoded[:, 2:4] = (boxes[:, :2] + boxes[:, 2:]) / 2.0, boxes[:, 2:] - boxes[:, :2]
    np.testing.assert_allclose(layout.boxes([decoded[None]])[0], boxes)
    np.testing.assert_array_equal(layout.normalised(np.array([[[1, 2, 3]]], dtype=np.uint8)), [[[3.0, 2.0, 1.0]]])
    with pytest.raises(ValueError, match="it has 125 boxes, not one for each of the 126 cells"):
        layout.boxes([table[None, :-1]])


def test_a_transposed_table_is_read_by_the_layout_that_is_given(tmp_path: Path) -> None:
    """Without, a wrong number of class names would make a layout of another: see the next test."""
    path = write_network(tmp_path / "net.onnx", "yolov8_rows")
    detector = OnnxDetector(path, COLOURS, DetectorSettings(layout="yolov8", least_score=0.6))
    found = detect(detector, black_with_block((64, 64), (16, 24, 24, 32), "green"))
    assert found.labels == ("green",)
    np.testing.assert_allclose(found.boxes, [[16.0, 24.0, 24.0, 32.0]], atol=1e-4)
    with pytest.raises(InputError, match=r"\(1, 64, 7\) are none of \(1, N, 8\) of yolov5; "):
        OnnxDetector(path, COLOURS, DetectorSettings(layout="yolov5"))


@pytest.mark.parametrize(
    ("layout", "names", "fault"),
    [
        ("yolov8", COLOURS[:2], r"with 2 class names its outputs \(1, 7, 64\) are none of .*give its own class names"),
        ("nanodet", COLOURS[:2], r"with 2 class names its outputs \(1, 64, 3\) \(1, 64, 16\) are none of"),
        ("yolov8_shares", COLOURS, "not in pixels of the input"),
        ("yolov8_logits", COLOURS, r"scores from -10 to 1 are not between 0 and 1; apply a sigmoid in the export"),
        ("end_to_end_logits", COLOURS, "apply a sigmoid in the export"),
        ("yolov5", (*COLOURS, "none"), r"with 4 class names its outputs \(1, 64, 8\) are none of"),
        ("yolov8_rows", COLOURS, r"\(1, 7, N\) of yolov8"),
    ],
)
def test_outputs_that_fit_no_layout_are_one_line_at_the_start(
    layout: str, names: tuple[str, ...], fault: str, tmp_path: Path
) -> None:
    path = write_network(tmp_path / "net.onnx", layout)
    with pytest.raises(InputError, match=fault) as told:
        OnnxDetector(path, names)
    assert "\n" not in str(told.value) and str(path) in str(told.value)


def test_an_end_to_end_table_of_shares_is_refused_with_its_first_box(tmp_path: Path) -> None:
    detector = OnnxDetector(write_network(tmp_path / "net.onnx", "end_to_end_shares"), COLOURS, SURE)
    assert not len(detect(detector, np.zeros((64, 64, 3), dtype=np.uint8)))
    with pytest.raises(InputError, match=r"in shares of the input, not in its pixels; export it"):
        detect(detector, black_with_block((64, 64), (16, 24, 24, 32), "green"))


def test_rows_that_only_fill_an_end_to_end_table_up_are_not_boxes_in_shares(tmp_path: Path) -> None:
    every = DetectorSettings(least_score=0.0)
    detector = OnnxDetector(write_network(tmp_path / "net.onnx", "end_to_end"), COLOURS, every)
    assert "green" in detect(detector, black_with_block((64, 64), (16, 24, 24, 32), "green")).labels


def test_a_table_of_fractions_is_not_taken_for_an_end_to_end_networks(tmp_path: Path) -> None:
    """Rows of a YOLOv8 of two classes that lie the other way have six numbers, too."""
    path = write_network(tmp_path / "net.onnx", "two_classes_in_rows")
    with pytest.raises(InputError, match="no numbers of classes"):
        detect(OnnxDetector(path, COLOURS[:2]), black_with_block((64, 64), (16, 24, 20, 32), "green"))
    detector = OnnxDetector(path, COLOURS[:2], DetectorSettings(layout="yolov8", least_score=0.6))
    assert detect(detector, black_with_block((64, 64), (16, 24, 24, 32), "green")).labels == ("green",)


def test_of_boxes_that_overlap_the_better_one_stays() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [0.0, 0.0, 10.0, 9.0], [5.0, 0.0, 15.0, 10.0], [3.0, 3.0, 3.0, 9.0]])
    assert without_overlaps(boxes, np.array([0.5, 0.6, 0.4, 0.9]), 0.6).tolist() == [1, 2]


def test_a_picture_keeps_its_proportions_and_boxes_come_back_from_the_square() -> None:
    picture = np.full((48, 128, 3), 255, dtype=np.uint8)
    letterbox = letterboxed(picture, (64, 64), 0)
    assert (letterbox.scale, letterbox.left, letterbox.top) == (0.5, 0, 20)
    assert (letterbox.pixels[20:44] == 255).all() and letterbox.pixels.sum() == 255 * 64 * 24 * 3
    assert letterbox.to_picture(np.array([[0.0, 20.0, 64.0, 44.0]])).tolist() == [[0.0, 0.0, 128.0, 48.0]]


def test_files_that_are_no_detectors_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"no network")
    for path in (tmp_path / "net.onnx", tmp_path / "none.onnx"):
        with pytest.raises(InputError, match=path.name) as fault:
            OnnxDetector(path, ("chair",))
        assert "\n" not in str(fault.value)
    (tmp_path / "twice.names").write_text("cup\ncup\n")
    with pytest.raises(InputError, match="named twice"):
        read_class_names(tmp_path / "twice.names")

"""The inputs that an ONNX file declares, against the library of the format."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from worlds.views.onnx_networks import write_network

from semantic_slam.errors import InputError
from semantic_slam.perception.onnx.declared_inputs import declared_inputs, stated_class_names, stated_input_size
from semantic_slam.perception.onnx.detector import DetectorSettings, OnnxDetector


def sum_of(path: Path, *inputs: onnx.ValueInfoProto, weights: tuple[onnx.TensorProto, ...] = ()) -> Path:
    """File of a network that adds up its inputs, with weights that older exports list among them."""
    listed = [helper.make_tensor_value_info(weight.name, weight.data_type, weight.dims) for weight in weights]
    names = [own.name for own in (*inputs, *weights)]
    output = helper.make_tensor_value_info("y", TensorProto.FLOAT, ["rest"])
    graph = helper.make_graph(
        [helper.make_node("Sum", names, ["y"])], "sum", [*listed, *inputs], [output], initializer=list(weights)
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), str(path))
    return path


def pictures(name: str, *shape: int | str) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def test_sizes_are_read_and_open_ones_are_none(tmp_path: Path) -> None:
    path = sum_of(tmp_path / "net.onnx", pictures("images", "batch", 3, 640, "width"))
    assert declared_inputs(path) == {"images": (None, 3, 640, None)}


def test_weights_among_the_inputs_are_none(tmp_path: Path) -> None:
    weight = numpy_helper.from_array(np.ones((1, 3, 1, 1), dtype=np.float32), "weight")
    path = sum_of(tmp_path / "net.onnx", pictures("images", 1, 3, 384, 70000), weights=(weight,))
    assert declared_inputs(path) == {"images": (1, 3, 384, 70000)}


def test_a_file_of_pytorch_is_read_as_well(tmp_path: Path) -> None:
    assert declared_inputs(write_network(tmp_path / "net.onnx", "yolov8", size=(32, 96))) == {"images": (1, 3, 32, 96)}


@pytest.mark.parametrize(
    ("stated", "size"),
    [("[320, 640]", (320, 640)), ("416", (416, 416)), ("[]", (None, None)), ("[0, 0]", (None, None))],
)
def test_the_size_that_an_export_states_fills_in_for_an_open_one(
    stated: str, size: tuple[int | None, int | None], tmp_path: Path
) -> None:
    path = write_network(tmp_path / "net.onnx", "yolov8", open_sizes=(0, 2, 3))
    assert stated_input_size(path) == (None, None)
    model = onnx.load(str(path))
    model.metadata_props.add(key="stride", value="32")
    model.metadata_props.add(key="imgsz", value=stated)
    onnx.save(model, str(path))
    assert stated_input_size(path) == size
    if size == (320, 640):
        assert OnnxDetector(path, ("red", "green", "blue")).input_size == size
        assert OnnxDetector(path, ("red", "green", "blue"), DetectorSettings(input_size=64)).input_size == (64, 64)


@pytest.mark.parametrize(
    ("stated", "names", "fault"),
    [
        ("{0: 'red', 1: 'green', 2: 'blue'}", ("red", "green", "blue"), ""),
        ("['rouge', 'vert', 'bleu']", ("rouge", "vert", "bleu"), ""),
        ("{0: 'red', 1: 'green'}", ("red", "green"), "states 2 classes, and 3 are named"),
        ("{2: 'red', 1: 'green', 0: 'blue'}", ("blue", "green", "red"), "the same classes in another order"),
        ("{1: 'red', 2: 'green'}", (), ""),
        ("__import__('os')", (), ""),
        ("[" * 9999, (), ""),
    ],
)
def test_the_names_that_an_export_states_are_compared_at_the_start(
    stated: str, names: tuple[str, ...], fault: str, tmp_path: Path
) -> None:
    """Of an end-to-end table, whose shape tells nothing of the classes."""
    path = write_network(tmp_path / "net.onnx", "end_to_end")
    model = onnx.load(str(path))
    model.metadata_props.add(key="names", value=stated)
    onnx.save(model, str(path))
    assert stated_class_names(path) == names
    with pytest.raises(InputError, match=fault) if fault else nullcontext():
        OnnxDetector(path, ("red", "green", "blue"))


def test_names_in_another_encoding_keep_no_network_from_being_read(tmp_path: Path) -> None:
    path = write_network(tmp_path / "net.onnx", "yolov8", size=(32, 96))
    author = b"\x0a\x06author\x12\x02\xe9\xe8"  # an entry of metadata in Latin-1
    path.write_bytes(path.read_bytes() + b"\x72" + bytes([len(author)]) + author)
    assert OnnxDetector(path, ("red", "green", "blue")).input_size == (32, 96)
    assert stated_input_size(path) == (None, None)


@pytest.mark.parametrize(
    "inputs",
    [(pictures("a", 1, 3, 8, 8), pictures("b", 1, 3, 8, 8)), (pictures("a", 1, 8, 8, 3),), (pictures("a", 5),)],
)
def test_a_network_of_other_inputs_than_one_of_pictures_is_refused(
    inputs: tuple[onnx.ValueInfoProto, ...], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"its inputs are .*; export it with one, pictures of 1x3xHxW"):
        OnnxDetector(sum_of(tmp_path / "net.onnx", *inputs), ("chair",))

"""Inputs that an ONNX file declares, and metadata, which OpenCV does not tell: from the file's protocol buffer.

Field numbers are those of onnx.proto3: ModelProto.graph 7, .metadata_props 14; StringStringEntryProto.key 1, .value 2;
GraphProto.initializer 5, .input 11; TensorProto.name 8;
ValueInfoProto.name 1, .type 2; TypeProto.tensor_type 1; TypeProto.Tensor.shape 2; TensorShapeProto.dim 1;
TensorShapeProto.Dimension.dim_value 1.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

VARINT, FIXED_64, LENGTH_DELIMITED, FIXED_32 = 0, 1, 2, 5
"""Wire types of protocol buffers."""

Shape = tuple[int | None, ...]
"""Sizes of an input; None where the file leaves one open."""


def declared_inputs(path: Path) -> dict[str, Shape]:
    """Name -> shape of every input that is not a weight, for a file that OpenCV has read.

    Older exports list the weights among the inputs, too.
    """
    inputs: dict[str, Shape] = {}
    weights: set[str] = set()
    for graph in _messages(memoryview(path.read_bytes()), 7):
        weights.update(_text(tensor, 8) for tensor in _messages(graph, 5))
        inputs |= {_text(value, 1): _shape(value) for value in _messages(graph, 11)}
    return {name: shape for name, shape in inputs.items() if name not in weights}


def stated_input_size(path: Path) -> tuple[int | None, int | None]:
    """Height and width for which a network was exported, by the entry ``imgsz`` that Ultralytics' exports have.

    None where a file, which OpenCV has read, states none.
    """
    sizes = [int(number) for number in re.findall(r"\d+", _metadata(path).get("imgsz", ""))]
    return (sizes[0], sizes[-1]) if len(sizes) in (1, 2) and min(sizes) > 0 else (None, None)


def stated_class_names(path: Path) -> tuple[str, ...]:
    """Class names in the order of their numbers, by the entry ``names`` that Ultralytics' exports have.

    It is a Python literal, {0: 'person', 1: 'bicycle'} or a list. () where a file, which OpenCV has read, states none.
    """
    try:
        stated = ast.literal_eval(_metadata(path).get("names", ""))
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return ()
    numbered = dict(enumerate(stated)) if isinstance(stated, list) else stated
    if not isinstance(numbered, dict) or set(numbered) != set(range(len(numbered))):
        return ()
    return tuple(str(numbered[number]) for number in range(len(numbered)))


def _metadata(path: Path) -> dict[str, str]:
    """Entries of a file's metadata."""
    return {_text(entry, 1): _text(entry, 2) for entry in _messages(memoryview(path.read_bytes()), 14)}


def _shape(value: memoryview) -> Shape:
    """Sizes of a ValueInfoProto."""
    return tuple(
        next((size for number, size in _fields(dimension) if number == 1 and isinstance(size, int) and size > 0), None)
        for kind in _messages(value, 2)
        for tensor in _messages(kind, 1)
        for shape in _messages(tensor, 2)
        for dimension in _messages(shape, 1)
    )


def _messages(message: memoryview, wanted: int) -> Iterator[memoryview]:
    """Length-delimited fields of that number."""
    return (value for number, value in _fields(message) if number == wanted and isinstance(value, memoryview))


def _text(message: memoryview, number: int) -> str:
    return next((bytes(text).decode(errors="replace") for text in _messages(message, number)), "")


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Number and value of every field of a message: an integer, or the bytes of anything else."""
    start = 0
    while start < len(message):
        tag, start = _varint(message, start)
        number, kind = tag >> 3, tag & 7
        if kind == VARINT:
            value, start = _varint(message, start)
            yield number, value
            continue
        size = {FIXED_64: 8, FIXED_32: 4}.get(kind)
        if size is None:
            size, start = _varint(message, start)
        yield number, message[start : start + size]
        start += size


def _varint(message: memoryview, start: int) -> tuple[int, int]:
    """Unsigned integer of seven bits a byte, the least first, and where it ends."""
    value = shift = 0
    while True:
        byte = message[start]
        value |= (byte & 0x7F) << shift
        start, shift = start + 1, shift + 7
        if byte < 0x80:
            return value, start

"""Which layout a network has, by the shapes of its outputs and the number of its classes."""

from collections.abc import Sequence
from pathlib import Path

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.onnx.layout import Layout
from semantic_slam.perception.onnx.nanodet import NanoDet
from semantic_slam.perception.onnx.yolo import ByCell, EndToEnd, WithClassScores, WithObjectness, YoloTable, table_of

TABLES: dict[str, type[YoloTable]] = {
    layout.name: layout for layout in (WithObjectness, WithClassScores, EndToEnd, ByCell)
}
"""Layouts of a single output, by the name that a user may give."""


def recognised(
    outputs: Sequence[Array], num_classes: int, size: tuple[int, int], given: str | None, origin: Path
) -> Layout:
    """Layout of a network with these outputs for an input of ``size`` (height, width).

    A single output may lie transposed, or fit several layouts, where ``given`` names its layout, one of :data:`TABLES`:
    a transposed table of C classes has the shape of another layout's with one class more or less, so that a wrong
    number of class names would go unnoticed. Raises InputError where no layout fits, or several.
    """
    if given not in (None, *TABLES):
        raise InputError(f"'{given}' is no layout of a detector; choose one of {', '.join(TABLES)}, or leave it out")
    if len([output for output in outputs if output.ndim == 3 and len(output) == 1]) == 1:
        return _table_layout(outputs, num_classes, size, given, origin)
    nanodet = None if given else NanoDet.of(outputs, num_classes, size)
    if nanodet is None:
        raise InputError(_unknown(outputs, num_classes, given, origin))
    return nanodet


def _by_shape() -> list[type[YoloTable]]:
    """Layouts that are told by the shape of their table."""
    return [layout for layout in TABLES.values() if not layout.is_only_named]


def _table_layout(
    outputs: Sequence[Array], num_classes: int, size: tuple[int, int], given: str | None, origin: Path
) -> Layout:
    shape = table_of(outputs).shape
    layouts = [TABLES[given]] if given else _by_shape()
    ways = [layout.of(shape, num_classes, size, in_any_turn=bool(given)) for layout in layouts]
    found = [way for way in ways if way is not None]
    if not found:
        raise InputError(_unknown(outputs, num_classes, given, origin))
    if len(found) > 1:
        names = " or ".join(way.name for way in found)
        raise InputError(f"{origin}: its output {_shapes(outputs)} may be {names}; name the layout (--layout)")
    return found[0]


def _unknown(outputs: Sequence[Array], num_classes: int, given: str | None, origin: Path) -> str:
    of_names = f"{num_classes} class name{'' if num_classes == 1 else 's'}"
    tables = [_expected(layout, num_classes) for layout in ([TABLES[given]] if given else _by_shape())]
    known = ", ".join(tables if given else [*tables, "NanoDet's pairs"])
    return (
        f"{origin}: with {of_names} its outputs {_shapes(outputs)} are none of {known}; give its own class names, or"
        " export it in such a layout"
    )


def _expected(layout: type[YoloTable], num_classes: int) -> str:
    columns = layout.num_columns(num_classes)
    return f"(1, {columns}, N) of {layout.name}" if layout.usually_transposed else f"(1, N, {columns}) of {layout.name}"


def _shapes(outputs: Sequence[Array]) -> str:
    return " ".join(str(output.shape) for output in outputs)

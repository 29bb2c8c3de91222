"""What makes HTML of the parts of a report: its templates, in which every value is escaped."""

import json
from collections.abc import Sequence
from functools import cache
from typing import Any

import jinja2

from semantic_slam.report.shown.boxes import BoxView
from semantic_slam.report.wording import number, percent


@cache
def environment() -> jinja2.Environment:
    """Templates of this package, compiled once per process; every value is escaped."""
    found = jinja2.Environment(
        loader=jinja2.PackageLoader("semantic_slam.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    found.filters |= {"number": number, "series": series, "percent": percent}
    return found


def series(chart_keys: list[Any]) -> str:
    """The values of a legend as JSON, three significant digits."""
    return json.dumps(
        [[None if value != value else float(f"{value:.3g}") for value in key.values] for key in chart_keys]
    )


def shown_picture(keyframe: int, source: str, size: tuple[int, int], boxes: Sequence[BoxView]) -> dict[str, Any]:
    """A picture as the page's script shows it; ``source`` is its address, ``size`` width and height in pixels."""
    return {
        "k": keyframe,
        "src": source,
        "width": size[0],
        "height": size[1],
        "boxes": [
            [box.left, box.top, box.width, box.height, box.colour, box.verdict, box.places, box.text, box.label]
            for box in boxes
        ],
    }

"""The page: one HTML file with everything inside, readable without a network."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.answers.explain.explanation import Explanation
from semantic_slam.inference.hypotheses import RECENT_KEYFRAMES
from semantic_slam.report.comparison import Run
from semantic_slam.report.document import Analysis
from semantic_slam.report.drawing.charts import time_charts, truth_charts
from semantic_slam.report.drawing.explanation_charts import explanation_charts
from semantic_slam.report.drawing.noise_charts import noise_charts
from semantic_slam.report.drawing.palette import OTHER_COLOUR, colours_by_weight
from semantic_slam.report.metrics_table import metric_rows
from semantic_slam.report.plain_json import plain
from semantic_slam.report.rendering import environment, shown_picture
from semantic_slam.report.shown.comparison_view import comparison_view
from semantic_slam.report.shown.descriptors import descriptor_figures
from semantic_slam.report.shown.evidence import evidence_views, shown_views
from semantic_slam.report.shown.frames import FrameView, Pictures, picture_views
from semantic_slam.report.shown.objects import ObjectView, object_views
from semantic_slam.report.shown.scene import moments, scene
from semantic_slam.report.verdict import verdict, warnings


def render_page(runs: Sequence[Run], source_bag: Path | None, explained: Sequence[Explanation] = ()) -> str:
    """The text of ``report.html``: of the first run, the others beside it. Whatever comes from a bag is escaped.

    ``explained``: what the first run says for what it believes of its objects.
    """
    analysis = runs[0].analysis
    last = analysis.record.beliefs[-1]
    colours = colours_by_weight(np.nan_to_num(last.existence) @ last.class_probabilities)
    classes = list(zip(last.class_names, colours, strict=True))
    pictures = picture_views(analysis, source_bag, colours, shown_views(analysis, explained))
    entries = {
        "classes": classes,
        "legend": legend(classes),
        "evidence": evidence_views(analysis, explained, pictures.views),
        "descriptors": descriptor_figures(analysis),
        "comparison": comparison_view(runs, classes),
        **_of_run(analysis),
        **_of_objects(analysis, object_views(analysis, colours, pictures.crops)),
        **_of_scene(scene(analysis, colours), pictures),
        **_of_pictures(pictures),
        **_of_charts(analysis),
    }
    return environment().get_template("report.html").render(entries)


def legend(classes: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Names and colours of the classes that have a colour of their own, and one entry for those that share a grey."""
    own = [(name, colour) for name, colour in classes if colour != OTHER_COLOUR]
    return own if len(own) == len(classes) else [*own, ("other classes", OTHER_COLOUR)]


def _of_run(analysis: Analysis) -> dict[str, Any]:
    """What is said of the run as a whole."""
    record = analysis.record
    first, last = record.beliefs[0], record.beliefs[-1]
    return {
        "title": Path(analysis.bag["path"]).name,
        "bag": analysis.bag,
        "run": record.run,
        "start": analysis.start.text(planar=last.planar),
        "seed": analysis.configuration.get("seed"),
        "configuration": flat(analysis.configuration),
        "last": last,
        "recent_keyframes": RECENT_KEYFRAMES,
        "duration_s": (last.stamp_ns - first.stamp_ns) * 1e-9,
        "most_hypotheses": max(len(belief.hypothesis_ids) for belief in record.beliefs),
        "detections": sum(len(belief.detection_ids) for belief in record.beliefs),
        "dropped": record.dropped,
        "moments": [(place, record.beliefs[place].keyframe) for place in moments(record.beliefs)],
    }


def _of_objects(analysis: Analysis, objects: list[ObjectView]) -> dict[str, Any]:
    """The objects of the last belief, with what is said of them."""
    last = analysis.record.beliefs[-1]
    return {
        "objects": objects,
        "verdict": verdict(analysis, objects),
        "warnings": warnings(analysis, objects),
        "axes": "x, y" if last.planar else "x, y, z",
        "may_move": bool(np.isfinite(last.moving).any()),
        "may_leave": bool(np.isfinite(last.missing).any()),
        "judges_models": any(np.isfinite(view.mutual_information) for view in objects)
        or not all(view.in_coverage for view in objects),
    }


def _of_scene(drawn: dict[str, Any], pictures: Pictures) -> dict[str, Any]:
    """The map with its slider."""
    return {
        "scene": plain({**drawn, "pictures": slider_pictures(pictures.slider)}),
        "may_fade": any(frame["e"] for frame in drawn["frames"]),
        "has_places": any("p" in frame for frame in drawn["frames"]),
    }


def _of_pictures(pictures: Pictures) -> dict[str, Any]:
    """The camera's pictures."""
    return {
        "frames": pictures.frames,
        "no_frames": pictures.why_none,
        "has_crops": bool(pictures.crops),
        "has_words": any(box.label for frame in pictures.frames for box in frame.boxes),
    }


def _of_charts(analysis: Analysis) -> dict[str, Any]:
    """The charts over the keyframes; those against the ground truth are empty without it."""
    record, evaluation = analysis.record, analysis.evaluation
    return {
        "charts": [*time_charts(analysis), *explanation_charts(record)],
        "noise_charts": noise_charts(record.beliefs),
        "truth_charts": truth_charts(evaluation, record.beliefs) if evaluation else [],
        "metrics": metric_rows(evaluation.metrics) if evaluation else [],
    }


def slider_pictures(views: Mapping[int, FrameView]) -> list[dict[str, Any]]:
    """The slider's pictures, in order."""
    return [
        shown_picture(view.keyframe, f"data:image/jpeg;base64,{view.data}", (view.width, view.height), view.boxes)
        for _, view in sorted(views.items())
    ]


def flat(configuration: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Dotted names and values, as ROS parameters are named."""
    rows: list[tuple[str, str]] = []
    for name, value in configuration.items():
        rows += flat(value, f"{prefix}{name}.") if isinstance(value, dict) else [(f"{prefix}{name}", json.dumps(value))]
    return rows

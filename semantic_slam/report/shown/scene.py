"""The map over time, as plain data that the page's script draws."""

from typing import Any

import numpy as np

from semantic_slam.evaluation.evaluate import dead_reckonings
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.spatial_reader import camera_of
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.report.document import Analysis
from semantic_slam.report.shown.keyframe import hypothesis_rows, keyframe_scene, rounded
from semantic_slam.report.shown.objects import object_label, true_positions
from semantic_slam.report.shown.space import camera_pyramid

SHOWN_HYPOTHESES = 16
"""Heaviest hypotheses of a keyframe that are drawn, besides the ancestors of those drawn later."""
SHOWN_MOMENTS = 4


def scene(analysis: Analysis, colours: list[str]) -> dict[str, Any]:
    """Hypotheses and objects per keyframe, reference paths, extent in metres; in space the camera's pyramid, too."""
    beliefs = analysis.record.beliefs
    last = beliefs[-1]
    drawn = _drawn_hypotheses(beliefs)
    stamps = np.array([belief.stamp_ns for belief in beliefs], dtype=np.int64)
    evaluation = analysis.evaluation
    dead = evaluation.dead_reckoning if evaluation else dead_reckonings(analysis.record, None, stamps)[0]
    true_objects = true_positions(analysis)
    axes = 2 if last.planar else 3
    true_path = _points(evaluation.true_poses, axes) if evaluation else []
    data = {
        "classes": [{"name": name, "colour": colour} for name, colour in zip(last.class_names, colours, strict=True)],
        "objects": [
            {"label": object_label(last, row), "id": int(number), "true": rounded(true_objects.get(int(number)))}
            for row, number in enumerate(last.object_ids)
        ],
        "truth": true_path,
        "dead": _points(dead, axes),
        "frames": _frames(beliefs, drawn),
        "camera": [] if last.planar else [rounded(point) for point in _camera(analysis)],
    }
    return {**data, "extent": _extent(data)}


def moments(beliefs: tuple[HybridBelief, ...]) -> list[int]:
    """Up to four keyframes (by place) that tell the story: first, last, where hypotheses went, else evenly spread.

    None lies nearer to another than a tenth of the run.
    """
    last = len(beliefs) - 1
    association = np.array([belief.association_entropy for belief in beliefs])
    component = np.array([belief.component_entropy for belief in beliefs])
    shown = [_below(association, 0.5), _below(component, 0.05), _below(component, 0.5), last // 3, 2 * last // 3]
    chosen = [0]
    for place in (last, *shown):
        if len(chosen) < SHOWN_MOMENTS and min(abs(place - other) for other in chosen) > last / 10:
            chosen.append(place)
    return sorted(chosen)


def _below(values: Array, share: float) -> int:
    """Place from which ``values`` stay below this share of their maximum; the last place when they do not."""
    above = np.flatnonzero(values > share * values.max(initial=0.0))
    return min(int(above[-1]) + 1, len(values) - 1) if len(above) else 0


def _drawn_hypotheses(beliefs: tuple[HybridBelief, ...]) -> list[list[int]]:
    """Rows drawn at every keyframe: the heaviest ones and the parents of those drawn at the next keyframe."""
    drawn: list[list[int]] = []
    needed: set[int] = set()
    for belief in reversed(beliefs):
        heavy = set(np.argsort(-belief.log_weights, kind="stable")[:SHOWN_HYPOTHESES].tolist())
        rows = sorted(heavy | {row for row, value in enumerate(belief.hypothesis_ids) if int(value) in needed})
        needed = {int(belief.parent_ids[row]) for row in rows}
        drawn.append(rows)
    return drawn[::-1]


def _frames(beliefs: tuple[HybridBelief, ...], drawn: list[list[int]]) -> list[dict[str, Any]]:
    frames: list[dict[str, Any]] = []
    place: dict[int, int] = {}
    numbers = {int(number): row for row, number in enumerate(beliefs[-1].object_ids)}
    written: dict[int, Array] = {}
    for belief, rows in zip(beliefs, drawn, strict=True):
        hypotheses = hypothesis_rows(belief, rows, place)
        frames.append(keyframe_scene(belief, beliefs[0].stamp_ns, hypotheses, numbers, written))
        place = {int(belief.hypothesis_ids[row]): index for index, row in enumerate(rows)}
    return frames


def _camera(analysis: Analysis) -> Array:
    measured = [*analysis.record.measurements.values()]
    camera = camera_of(measured[-1]) if measured else Camera()
    return camera_pyramid(camera, analysis.configuration.get("open_world", {}))


def _points(poses: Array, axes: int) -> list[list[float]]:
    return [rounded(pose[:axes]) for pose in poses if np.isfinite(pose[:axes]).all()]


def _extent(data: dict[str, Any]) -> list[float]:
    """x_min y_min x_max y_max: objects, truth and the final path whole; what strays far beyond is cut off."""
    frames = data["frames"]
    best = [max(frame["h"], key=lambda row: row[1])[2:4] for frame in frames[len(frames) // 2 :]]
    objects = [row[1:3] for frame in frames[-1:] for row in frame["o"]]
    objects += [row[2:4] for frame in frames[-1:] for row in frame.get("p", [])]
    objects += [item["true"][:2] for item in data["objects"] if item["true"]]
    truth, dead = ([point[:2] for point in data[name]] for name in ("truth", "dead"))
    core = np.array(best + objects + truth + _last_states(frames))
    low, high = core.min(axis=0), core.max(axis=0)
    room = 0.35 * float(max(high - low)) + 0.5
    stray = np.array([row[2:4] for frame in frames for row in frame["h"] if row[1] > 0.05] + dead)
    inside = stray[((stray > low - room) & (stray < high + room)).all(axis=1)]
    every = np.vstack([core, inside])
    margin = 0.04 * float(np.max(every.max(axis=0) - every.min(axis=0))) + 0.4
    return [round(float(value), 3) for value in (*(every.min(axis=0) - margin), *(every.max(axis=0) + margin))]


def _last_states(frames: list[dict[str, Any]]) -> list[list[float]]:
    last = {row[0]: row[1:3] for frame in frames for row in frame["o"]}
    return list(last.values())

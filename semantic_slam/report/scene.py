"""The map over time, as plain data that the page's script draws."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.evaluation.evaluate import dead_reckonings
from semantic_slam.evaluation.history import best_index
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.maps.from_belief import MOVES
from semantic_slam.report.document import Analysis
from semantic_slam.report.ellipse import ellipses
from semantic_slam.report.objects import object_label, true_object_poses

SHOWN_HYPOTHESES = 16
"""Heaviest hypotheses of a keyframe that are drawn, besides the ancestors of those drawn later."""
SHOWN_MOMENTS = 4
MOVED_M, CHANGED = 0.01, 0.004
"""An object is written again when it moved this far, or its probabilities or size changed this much."""


def scene(analysis: Analysis, colours: list[str]) -> dict[str, Any]:
    """Hypotheses and objects per keyframe, reference paths, extent in metres."""
    beliefs = analysis.record.beliefs
    last = beliefs[-1]
    drawn = _drawn_hypotheses(beliefs)
    stamps = np.array([belief.stamp_ns for belief in beliefs], dtype=np.int64)
    evaluation = analysis.evaluation
    dead = evaluation.dead_reckoning if evaluation else dead_reckonings(analysis.record, None, stamps)[0]
    true_objects = true_object_poses(analysis)
    true_path = _points(evaluation.true_poses) if evaluation else []
    data = {
        "classes": [{"name": name, "colour": colour} for name, colour in zip(last.class_names, colours, strict=True)],
        "objects": [
            {"label": object_label(last, row), "id": int(number), "true": _rounded(true_objects.get(int(number)))}
            for row, number in enumerate(last.object_ids)
        ],
        "truth": true_path,
        "dead": _points(dead),
        "frames": _frames(beliefs, drawn),
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
        best = best_index(belief)
        seen = [numbers.get(int(belief.object_ids[row]), -1) for row in belief.associations[best] if row >= 0]
        frames.append(
            {
                "k": belief.keyframe,
                "t": round((belief.stamp_ns - beliefs[0].stamp_ns) * 1e-9, 2),
                "n": len(belief.hypothesis_ids),
                "h": _hypotheses(belief, rows, place),
                "o": _changed_objects(belief, numbers, written),
                "s": [row for row in seen if row >= 0],
                **_movers(belief, numbers),
            }
        )
        place = {int(belief.hypothesis_ids[row]): index for index, row in enumerate(rows)}
    return frames


def _hypotheses(belief: HybridBelief, rows: list[int], place: dict[int, int]) -> list[list[float]]:
    """Per hypothesis: place of its parent in the frame before (-1 none), weight, x, y, yaw, ellipse."""
    states = np.column_stack(
        [np.exp(belief.log_weights), planar_from_pose_vector(belief.poses), ellipses(belief.pose_covariances)]
    )
    return [[place.get(int(belief.parent_ids[row]), -1), *_rounded(states[row], 4)] for row in rows]


def _changed_objects(belief: HybridBelief, numbers: dict[int, int], written: dict[int, Array]) -> list[list[float]]:
    """Per changed object: place in the list of objects, x, y, yaw, ellipse, sigma of yaw, class probabilities."""
    covariances = belief.object_covariances
    states = np.column_stack(
        [
            planar_from_pose_vector(belief.object_poses),
            ellipses(covariances),
            np.sqrt(np.maximum(covariances[:, 5, 5], 0.0)),
            belief.class_probabilities,
        ]
    )
    before = np.array([written.get(int(number), np.full(states.shape[1], np.nan)) for number in belief.object_ids])
    changed = _differs(states, before.reshape(states.shape)) & np.isfinite(states).all(axis=1)
    rows = [row for row in np.flatnonzero(changed) if int(belief.object_ids[row]) in numbers]
    written.update({int(belief.object_ids[row]): states[row] for row in rows})
    return [[numbers[int(belief.object_ids[row])], *_rounded(states[row])] for row in rows]


def _movers(belief: HybridBelief, numbers: dict[int, int]) -> dict[str, list[list[float]]]:
    """Per object that moves: place in the list of objects, velocity along x and y [m/s]; nothing where none does."""
    rows = [row for row in np.flatnonzero(belief.moving > MOVES) if int(belief.object_ids[row]) in numbers]
    moving = [[numbers[int(belief.object_ids[row])], *_rounded(belief.object_velocities[row, :2])] for row in rows]
    return {"m": moving} if moving else {}


def _differs(states: Array, before: Array) -> NDArray[np.bool_]:
    """(O,) whether states differ enough to be written; those never written before are NaN, and do."""
    step = np.abs(states - before)
    same = (step[:, [0, 1, 3, 4]] <= MOVED_M).all(axis=1) & (step[:, 7:] <= CHANGED).all(axis=1)
    return np.asarray(~same | np.isnan(before[:, 0]))


def _points(poses: Array) -> list[list[float]]:
    return [_rounded(pose[:2]) for pose in poses if np.isfinite(pose[:2]).all()]


def _rounded(values: Any, digits: int = 3) -> Any:
    return None if values is None else [round(float(value), digits) for value in values]


def _extent(data: dict[str, Any]) -> list[float]:
    """x_min y_min x_max y_max: objects, truth and the final path whole; what strays far beyond is cut off."""
    frames = data["frames"]
    best = [max(frame["h"], key=lambda row: row[1])[2:4] for frame in frames[len(frames) // 2 :]]
    objects = [row[1:3] for frame in frames[-1:] for row in frame["o"]]
    objects += [item["true"][:2] for item in data["objects"] if item["true"]]
    core = np.array(best + objects + data["truth"] + _last_states(frames))
    low, high = core.min(axis=0), core.max(axis=0)
    room = 0.35 * float(max(high - low)) + 0.5
    stray = np.array([row[2:4] for frame in frames for row in frame["h"] if row[1] > 0.05] + data["dead"])
    inside = stray[((stray > low - room) & (stray < high + room)).all(axis=1)]
    every = np.vstack([core, inside])
    margin = 0.04 * float(np.max(every.max(axis=0) - every.min(axis=0))) + 0.4
    return [round(float(value), 3) for value in (*(every.min(axis=0) - margin), *(every.max(axis=0) + margin))]


def _last_states(frames: list[dict[str, Any]]) -> list[list[float]]:
    last = {row[0]: row[1:3] for frame in frames for row in frame["o"]}
    return list(last.values())

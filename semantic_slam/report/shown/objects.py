"""Object section of the report: table rows, and the course of the class probabilities."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from semantic_slam.geometry.moments import largest_sigma_m
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.identities import has_own_name
from semantic_slam.maps.from_belief import MOVES
from semantic_slam.report.document import Analysis
from semantic_slam.report.drawing.charts import time_plot
from semantic_slam.report.shown.frames import CropView

CERTAIN = 0.95
"""Probability of the most likely class from which an object counts as identified."""
EXISTS = 0.5
"""Existence from which on an object counts as one of the map."""
EQUAL = 1e-9
"""Difference of probabilities below which neither class is likelier."""
SHOWN_COURSES = 24
SHOWN_MOMENTS = 240


@dataclass(frozen=True)
class ObjectView:
    """One object at the end of a run, for the reader."""

    number: int
    label: str
    probabilities: list[float]  # (C,)
    class_name: str  # most likely class; "" where no class is likelier than all others
    probability: float
    true_class: str  # "" unknown
    existence: float
    moving: float  # probability that it moves; NaN where nothing may
    missing: float  # probability that it was there and has left; NaN where nothing leaves
    position: list[float]  # x, y, in space z
    sigma_m: float  # root of the largest eigenvalue of its covariance
    error_m: float  # from the true position of what stands still, NaN unknown
    mutual_information: float
    in_coverage: bool
    detections: int
    course: Markup | None
    doubt: Markup | None  # mutual information against keyframe, None where the run does not state it
    crop: CropView | None  # what it looks like, None without pictures

    @property
    def is_wrong(self) -> bool:
        """Whether what has been seen of it, or is sure of it, names another class than the true one."""
        told = self.class_name and (self.detections or self.certain)
        return bool(told and self.true_class) and self.true_class != self.class_name

    @property
    def certain(self) -> bool:
        return self.probability >= CERTAIN

    @property
    def exists(self) -> bool:
        """Whether that is likelier than not; so it is where the run does not doubt it."""
        return not self.existence < EXISTS


def object_views(
    analysis: Analysis, colours: list[str], crops: Mapping[int, CropView] | None = None
) -> list[ObjectView]:
    """All objects of the last belief, by id, with what those look like of which ``crops`` has a picture."""
    last = analysis.record.beliefs[-1]
    drawn = set(_worth_a_picture(analysis))
    return [
        _view(
            analysis,
            last,
            row,
            courses_svg(analysis, int(number), colours) if int(number) in drawn else None,
            doubt_svg(analysis, int(number)) if int(number) in drawn else None,
            (crops or {}).get(int(number)),
        )
        for row, number in enumerate(last.object_ids)
    ]


def _view(
    analysis: Analysis,
    last: HybridBelief,
    row: int,
    course: Markup | None,
    doubt: Markup | None,
    crop: CropView | None,
) -> ObjectView:
    number = int(last.object_ids[row])
    probabilities = last.class_probabilities[row]
    best = int(np.argmax(probabilities)) if len(probabilities) else -1
    is_likeliest = best >= 0 and not np.any(np.delete(probabilities, best) > probabilities[best] - EQUAL)
    evaluation = analysis.evaluation
    return ObjectView(
        number=number,
        label=object_label(last, row),
        probabilities=probabilities.tolist(),
        class_name=last.class_names[best] if is_likeliest else "",
        probability=float(probabilities[best]) if best >= 0 else float("nan"),
        true_class=evaluation.true_classes.get(number, "") if evaluation else "",
        existence=float(last.existence[row]),
        moving=float(last.moving[row]),
        missing=float(last.missing[row]),
        position=last.object_poses[row, : _axes(last)].tolist(),
        sigma_m=largest_sigma_m(last.object_covariances[row], _axes(last)),
        error_m=_error_m(analysis, last, row),
        mutual_information=float(last.mutual_information[row]),
        in_coverage=bool(last.in_coverage[row]),
        detections=analysis.detection_counts[number],
        course=course,
        doubt=doubt,
        crop=crop,
    )


def _axes(belief: HybridBelief) -> int:
    """How many coordinates of a place are estimated."""
    return 2 if belief.planar else 3


def _error_m(analysis: Analysis, last: HybridBelief, row: int) -> float:
    """Distance of an object from its true position; NaN where that is unknown, or where it moves."""
    true = true_positions(analysis).get(int(last.object_ids[row]))
    if true is None or last.moving[row] > MOVES:
        return float("nan")
    return float(np.linalg.norm(last.object_poses[row, : len(true)] - true))


def object_label(belief: HybridBelief, row: int) -> str:
    """The object's name where it says more than its number."""
    name, number = belief.object_names[row], int(belief.object_ids[row])
    return f"{number} · {name}" if has_own_name(number, name) else str(number)


def true_positions(analysis: Analysis) -> dict[int, NDArray[np.float64]]:
    """True position by object id: (2,), in space (3,)."""
    truth, evaluation = analysis.record.truth, analysis.evaluation
    if truth is None or truth.objects is None or evaluation is None:
        return {}
    rows = zip(truth.objects.object_ids, truth.objects.poses[:, : _axes(analysis.record.beliefs[-1])], strict=True)
    return {
        evaluation.matches[true]: place
        for true, place in rows
        if true in evaluation.matches and np.isfinite(place).all()
    }


def _worth_a_picture(analysis: Analysis) -> list[int]:
    """Ids of the objects that are least certain, or all when they are few; none where classes are not estimated."""
    last = analysis.record.beliefs[-1]
    if not last.class_names:
        return []
    certainty = last.class_probabilities.max(axis=1, initial=0.0)
    order = np.argsort(certainty, kind="stable")[:SHOWN_COURSES]
    return [int(last.object_ids[row]) for row in order]


def courses_svg(analysis: Analysis, number: int, colours: list[str]) -> Markup:
    """Stacked class probabilities of one object over the keyframes."""
    every = max(1, len(analysis.record.beliefs) // SHOWN_MOMENTS)
    moments = [belief for belief in analysis.record.beliefs[::-1][::every][::-1] if number in belief.object_ids]
    rows = np.array([belief.class_probabilities[list(belief.object_ids).index(number)] for belief in moments])
    options = {"width": 300, "height": 126, "margins": (12, 8, 20, 34)}
    plot = time_plot(analysis.record.beliefs, 0.0, 1.0, f"class probabilities of object {number}", **options)
    plot.axes(x_label="", y_ticks=(0, 0.5, 1), x_count=4)
    edges = np.hstack([np.zeros((len(rows), 1)), np.cumsum(rows, axis=1)])
    for index, colour in enumerate(colours):
        plot.area([belief.keyframe for belief in moments], edges[:, index], edges[:, index + 1], colour)
    return plot.svg()


def doubt_svg(analysis: Analysis, number: int) -> Markup | None:
    """Mutual information of one object over the keyframes [nats]; None where no belief states it."""
    beliefs = analysis.record.beliefs
    values = np.array(
        [
            next(iter(belief.mutual_information[belief.object_ids == number].tolist()), float("nan"))
            for belief in beliefs
        ]
    )
    if not np.isfinite(values).any():
        return None
    options = {"width": 300, "height": 84, "margins": (20, 8, 20, 34)}
    high = max(float(np.nanmax(values)) * 1.1, 0.01)
    plot = time_plot(beliefs, 0.0, high, f"mutual information of object {number} in nats", **options)
    plot.axes(x_label="", y_ticks=(0,), x_count=4)
    plot.caption(f"model doubt, up to {np.nanmax(values):.2g} nats")
    plot.line([belief.keyframe for belief in beliefs], values, "line first")
    return plot.svg()

"""Classes marginalised per object instead of enumerated: a table over class and heading for each.

The appearance of a view depends on the class and the side seen. Where no map gives an object's heading, both are
unknown jointly, and multimodally, as sides look alike. Given the positions of camera and object the views of one object
are independent of everything else, so p(class, heading | views) is a table, exact up to its grid, and its sum is the
views' evidence for the association. Headings and classes do not inform positions. In space objects count as upright,
the elevation of the camera is known with the positions, and the yaw is reported.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.semantics.camera_angles import camera_angles
from semantic_slam.inference.semantics.independent_views import ClassLikelihoods, DrawnFeatures
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.object_views import ObjectViews, class_posterior, coverage_of
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.yaw import Yaw
from semantic_slam.perception.uncertainty import mutual_information
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints
from semantic_slam.viewpoint.outliers import OutlierScores

HEADINGS = 72
"""Number of heading cells of a table: 5 degrees each."""
STEP_RAD = 2.0 * np.pi / HEADINGS


@dataclass(frozen=True)
class _Seen:
    """Likelihood of one detection for every azimuth of the camera in the object's frame, at one elevation."""

    around: Viewpoints  # HEADINGS
    log_likelihood: Array  # (C, HEADINGS)
    drawn: Array  # (HEADINGS, M, C) of draws of the measurement from the network, up to a constant
    known: dict[tuple[int, int, int], tuple[float, ObjectViews]] = field(default_factory=dict)


class ClassTables:
    """Evidence of views by tables over class and heading."""

    def __init__(self, model: ViewpointModel, tempering: float, outliers: OutlierScores | None = None) -> None:
        """``tempering``: number of views that count as one. ``outliers``: outlier scores; None: no outliers."""
        self._model, self._likelihoods = model, ClassLikelihoods(model, tempering, outliers)

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the configured viewpoint model, which the kind of class models must have."""
        assert models.viewpoint is not None
        return cls(models.viewpoint, models.tempering, models.outliers)

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Log evidence of the views of each candidate, and the objects' records after it."""
        rows = given.candidates.assignments
        robot, objects = rows.column("robot"), rows.column("object_states")
        total, records = np.zeros(len(rows)), [dict[int, ObjectViews]() for _ in range(len(rows))]
        for number, index in enumerate(given.used.tolist()):
            sensor, seen = given.step.detections[index].sensor, dict[int, _Seen]()
            of_objects = np.flatnonzero(rows.objects[:, number] >= 0)
            cells = _cells(given.parents[0].spaces, robot[of_objects], objects[of_objects, number], sensor)
            for row, (azimuth, elevation) in zip(of_objects.tolist(), cells.tolist(), strict=True):
                if elevation not in seen:
                    seen[elevation] = self._seen(given, index, elevation)
                place = int(rows.objects[row, number])
                object_id = int(given.object_ids[place])
                key, inside = (int(rows.parents[row]), place, azimuth), bool(given.step.in_coverage[index])
                added, records[row][object_id] = self._added(given, seen[elevation], key, inside)
                total[row] += added
        return SemanticEvidence.of(total, records)

    def _seen(self, given: SemanticInput, index: int, elevation: int) -> _Seen:
        """The likelihood of one detection from all directions in a cell of elevation."""
        angles: Array = STEP_RAD * np.arange(HEADINGS, dtype=np.float64)
        around = Viewpoints(angles, np.full(HEADINGS, STEP_RAD * elevation), np.ones(HEADINGS))
        drawn = DrawnFeatures.of([given.step.detections[index]]).take(np.zeros(HEADINGS, dtype=int))
        log_likelihood, exact = self._likelihoods.of(drawn, around)
        return _Seen(around, log_likelihood.T, exact)

    def _added(
        self, given: SemanticInput, seen: _Seen, key: tuple[int, int, int], inside: bool
    ) -> tuple[float, ObjectViews]:
        """Log evidence of one view of one object from the camera's cell around it, and the updated record.

        ``key``: parent, index of the object, and cell of the azimuth.
        """
        if key not in seen.known:
            parent, place, camera = key
            component, object_id = given.parents[parent], int(given.object_ids[place])
            before = component.views.get(object_id)
            table = before.recent[0] if before else _unseen(component, object_id, len(seen.drawn[0, 0]))
            prior = given.log_class_prior[place]
            azimuths = (camera - np.arange(HEADINGS)) % HEADINGS
            after = table + seen.log_likelihood[:, azimuths]
            by_class = finite_log_sum_exp(after)
            evidence = float(
                finite_log_sum_exp(prior + by_class) - finite_log_sum_exp(prior + finite_log_sum_exp(table))
            )
            draws = finite_log_sum_exp(table[None] + seen.drawn[azimuths].transpose(1, 2, 0))  # (M, C)
            best = int(np.argmax(prior + by_class))
            view = Viewpoints(*(value[azimuths[[int(after[best].argmax())]]] for value in vars(seen.around).values()))
            is_fitted = bool(self._model.in_coverage(np.array([best]), view)[0])
            record = ObjectViews(
                log_likelihood=by_class,
                mutual_information=float(mutual_information(class_posterior(prior, draws))),
                coverage=coverage_of(before).with_view(STEP_RAD * camera, is_recognised=inside, is_fitted=is_fitted),
                recent=(after,),
                yaw=None if component.spaces.landmark.attitude is None else _yaw(prior, after),
            )
            seen.known[key] = (evidence, record)
        return seen.known[key]


def _unseen(component: Component, object_id: int, num_classes: int) -> Array:
    """(C, HEADINGS) log prior over headings: by the map, or uniform."""
    log_heading, heading = np.zeros(HEADINGS), component.tracked_heading(object_id)
    if heading is not None:
        away = wrap_angle(STEP_RAD * np.arange(HEADINGS, dtype=np.float64) - heading[0])
        log_heading = -0.5 * away**2 / max(heading[1], STEP_RAD**2)
    return np.tile(log_heading - finite_log_sum_exp(log_heading), (num_classes, 1))


def _yaw(log_prior: Array, table: Array) -> Yaw:
    """The yaw of an object, over its classes, from their log prior (C,) and a (C, HEADINGS) table."""
    log_headings = finite_log_sum_exp((log_prior[:, None] + table).T)
    return Yaw.of(np.exp(log_headings - finite_log_sum_exp(log_headings)))


def _cells(spaces: Spaces, robots: Array, objects: Array, sensor: Array) -> Index:
    """(m, 2) cells of the :func:`camera_angles`."""
    cells = np.rint(camera_angles(spaces, robots, objects, sensor) / STEP_RAD).astype(int)
    cells[:, 0] %= HEADINGS
    return cells

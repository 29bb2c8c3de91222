"""Pairs of a detection and an object of poorly known range, linearised at their joint mode instead of the prediction.

The direction to an object seen from elsewhere is no linear function of its range. The search is in coordinates in which
the prior is Gaussian.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy, squared_norms
from semantic_slam.geometry.levenberg_marquardt import LevenbergMarquardt
from semantic_slam.geometry.rows import joined_rows, take
from semantic_slam.inference.association.gating import PairDensities
from semantic_slam.inference.association.pair_search import PairSearch
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.observation import Innovation, Linearisation, ObservationModel
from semantic_slam.inference.states.range_chart import LEAST_DISTANCE_M, moved_and_slopes, relative_sigmas
from semantic_slam.inference.states.spaces import Spaces

LEAST_SIGMA = 0.1
"""Relative standard deviation of a range below which a detection is linear enough at the prediction."""
LEAST_SQUARED_SINE = 1e-12
"""Least square of the sine between two rays that pass each other anywhere."""
FARTHEST_START = 3.0
"""Standard deviations of the log range from the prediction within which a search begins."""


@dataclass(frozen=True, kw_only=True)
class ParentPairs:
    """The pairs of one parent's D detections and M objects, at the prediction."""

    detections: Sequence[Any]  # D
    predicted: PredictedBelief
    anchors: Array  # (M, 3) from where objects were first seen along a ray alone; NaN of others
    pairs: PairDensities
    asked: Flags | None = None  # (D, M) which pairs are needed; None: all

    def problem(self, spaces: Spaces, model: ObservationModel) -> "PairProblem":
        """The search problem of the pairs that are too nonlinear at the prediction."""
        covariance, robot = self.predicted.pair_covariances[0], self.predicted.mean[0, 0, : spaces.storage.robot]
        objects = self.predicted.mean[0, 1:, : spaces.storage.landmark]
        known = np.flatnonzero(np.isfinite(self.anchors).all(axis=1))
        slopes = spaces.landmark.position_slopes(objects[known])
        of_place = slopes @ covariance[known, spaces.layout.robot :, spaces.layout.robot :] @ np.swapaxes(slopes, 1, 2)
        places = spaces.landmark.position(objects[known])
        wide = known[relative_sigmas(self.anchors[known], places, of_place) > LEAST_SIGMA]
        looked_at = np.zeros(self.pairs.distance.shape, dtype=bool)
        looked_at[:, wide] = True if self.asked is None else self.asked[:, wide]
        numbers, columns = np.nonzero(looked_at)
        used, place = np.unique(columns, return_inverse=True)
        return PairProblem(
            spaces=spaces,
            model=model,
            numbers=numbers,
            columns=columns,
            detections=model.collect(self.detections).take(numbers),
            robots=broadcast_copy(robot, (len(numbers), len(robot))),
            objects=objects[columns],
            anchors=self.anchors[columns],
            covariance=covariance[columns],
            root=np.linalg.cholesky(covariance[used])[place],
        )


def pairs_at_modes(spaces: Spaces, model: ObservationModel, parents: Sequence[ParentPairs]) -> list[PairDensities]:
    """The pairs of each parent, relinearised where needed; batched, with a result independent of the batch."""
    problems = [own.problem(spaces, model) for own in parents]
    ends = np.cumsum([len(own.numbers) for own in problems])
    if not len(ends) or not ends[-1]:
        return [own.pairs for own in parents]
    problem = PairProblem.joined(problems)
    y = problem.mode()
    part = problem.linearised(y)
    innovation = Innovation.of(part, problem.jacobian(part), problem.covariance)
    found = _Found(
        numbers=problem.numbers,
        columns=problem.columns,
        part=part,
        log_density=innovation.log_density,
        distance=innovation.distance,
        offsets=(problem.jacobian(part) @ problem.tangent(y)[..., None])[..., 0],
    )
    starts = [0, *ends[:-1].tolist()]
    return [
        take(found, slice(start, end)).put_into(own.pairs)
        for own, start, end in zip(parents, starts, ends.tolist(), strict=True)
    ]


@dataclass(frozen=True, kw_only=True)
class _Found:
    """B pairs at their modes."""

    numbers: Index  # (B,) detections
    columns: Index  # (B,) objects
    part: Linearisation
    log_density: Array  # (B,)
    distance: Array  # (B,)
    offsets: Array  # (B, m) of the linear residuals where they were linearised

    def put_into(self, pairs: PairDensities) -> PairDensities:
        """``pairs`` with these replaced; joint assignments are then linear at the modes of their pairs."""
        if not len(self.numbers):
            return pairs
        at, shape = (self.numbers, self.columns), pairs.distance.shape
        density, distance = pairs.log_density.copy(), pairs.distance.copy()
        density[at], distance[at] = self.log_density, self.distance
        part = replace(pairs.part, **{name: values.copy() for name, values in vars(pairs.part).items()})
        for name, values in vars(self.part).items():
            getattr(part, name)[at] = values
        offsets, elsewhere = np.zeros((*shape, self.offsets.shape[1])), np.zeros(shape, dtype=bool)
        if pairs.offsets is not None and pairs.elsewhere is not None:
            offsets, elsewhere = pairs.offsets.copy(), pairs.elsewhere.copy()
        offsets[at], elsewhere[at] = self.offsets, True
        return PairDensities(density, distance, part, offsets, elsewhere)


@dataclass(frozen=True, kw_only=True)
class PairProblem(PairSearch):
    """Pairs of a robot and an object first seen along a ray, in log range and the direction from there."""

    spaces: Spaces
    model: ObservationModel
    numbers: Index  # (B,) detections of their parents
    columns: Index  # (B,) objects of their parents
    detections: Any  # B
    robots: Array  # (B, s)
    objects: Array  # (B, s)
    anchors: Array  # (B, 3)
    covariance: Array  # (B, r + l, r + l) of robot and object
    root: Array  # (B, r + l, r + l) its Cholesky factor

    @classmethod
    def joined(cls, problems: Sequence["PairProblem"]) -> "PairProblem":
        """The pairs of several problems in one."""
        whole = joined_rows(problems, ("spaces", "model", "detections"))
        return replace(whole, detections=joined_rows([own.detections for own in problems], ()))

    def select(self, selection: Index) -> "PairProblem":
        """The chosen pairs."""
        return take(self, selection, _ROWS)

    def begun(self) -> LevenbergMarquardt:
        """At the prediction, or where the detection meets the object's ray, whichever has the lower energy.

        No descent leads from an object that is expected behind the camera to one in front of it.
        """
        met, rows = self._met(), np.arange(len(self.root))
        twice = self.select(np.concatenate([rows, rows]))
        both = LevenbergMarquardt(twice, np.concatenate([np.zeros(met.shape), met]))
        search = both.select(rows)
        search.take_lower(both.select(len(rows) + rows))
        return search

    def _met(self) -> Array:
        """(B, n) the mode given the log range at which the object's ray passes the detection; 0 where it does not.

        Two rays pass where they are nearest, in front of both.
        """
        seen, space = self.detections, self.spaces.robot
        camera = space.displacement(self.robots, seen.origin, np.zeros(3))
        look = space.displacement(self.robots, seen.ray, self.robots[:, :3])
        away = self.spaces.landmark.position(self.objects) - self.anchors
        distance = np.maximum(np.sqrt(squared_norms(away)), LEAST_DISTANCE_M)
        unit, apart = away / distance[:, None], camera - self.anchors
        cosine, along = np.vecdot(unit, look), np.vecdot(unit, apart)
        squared_sine = np.maximum(1.0 - cosine**2, LEAST_SQUARED_SINE)
        depth = np.where(seen.has_range, seen.range_m, (cosine * along - np.vecdot(look, apart)) / squared_sine)
        reach = along + cosine * depth
        row = np.zeros(self.root.shape[::2])
        row[:, self.spaces.layout.robot :] = (unit[:, None] @ self._slopes)[:, 0]
        whitened = (row[:, None] @ self.root)[:, 0]
        sigma = np.sqrt(squared_norms(whitened))
        ratio = np.log(np.where((reach > 0.0) & (depth > 0.0), reach, distance) / distance)
        steps = np.clip(ratio * distance / sigma, -FARTHEST_START, FARTHEST_START)
        return np.asarray((steps / sigma)[:, None] * whitened)

    def part(self, tangent: Array) -> Linearisation:
        size, space = self.spaces.layout.robot, self.spaces.robot
        step, chart = space.exp_and_jacobian(tangent[:, :size])
        along, objects = (self._slopes @ tangent[:, size:, None])[..., 0], self.objects.copy()
        places, slopes = moved_and_slopes(self.anchors, self.spaces.landmark.position(self.objects), along)
        objects[:, : places.shape[1]] = places
        part = self.model.geometry(self.detections, space.compose(self.robots, step), objects)
        by_place = part.jacobian_object @ np.swapaxes(self._slopes, 1, 2)
        return replace(
            part, jacobian_robot=part.jacobian_robot @ chart, jacobian_object=by_place @ slopes @ self._slopes
        )

    @cached_property
    def _slopes(self) -> Array:
        """(B, 3, l) Jacobians of the objects' positions, as attitudes stay."""
        return self.spaces.landmark.position_slopes(self.objects)


_ROWS = ("numbers", "columns", "detections", "robots", "objects", "anchors", "covariance", "root")
"""Fields of a :class:`PairProblem` that have a row for each pair."""

"""Placements of a lost robot on the map: where its own objects fit, and which map objects it would have missed there.

A localised history expects to detect the map objects in view, one that is not localised does not, so the same drive
implies other detection rates. Proposals are ranked by object geometry, and by detections and misses summed over sensor
settings, along the path of the history that is not localised.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.planar.region import SensorRegion, sensor_region
from semantic_slam.inference.open_world.planar.sightings import Sightings
from semantic_slam.inference.relocation.constellation import Fit, Fitting, positions
from semantic_slam.inference.relocation.stretches import stretches
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.starts import Starts

LEAST_OBJECTS = 3
"""Number of objects from which on the robot may be localised by them."""
LEAST_EXISTENCE = 0.5
MOST_OF_START = 2
"""Most placements of one start pose in one look."""
MOST_FITS = 12
"""Number of fits whose detections and misses are evaluated."""


@dataclass(frozen=True)
class Placement:
    """A history that localises the robot, with its estimated gain."""

    lineage: Lineage
    names: tuple[tuple[int, int], ...]  # pairs of an own object and the map object that it is
    log_gain: float  # relative to the history that it comes from, roughly

    @property
    def what(self) -> tuple[int, tuple[tuple[int, int], ...]]:
        """Identity of a placement: its start pose and its matches."""
        return self.lineage[0].mode, self.names


@dataclass(frozen=True, kw_only=True)
class Placements:
    """The placements of one history that is not localised, of T keyframes."""

    problem: Problem
    starts: Starts
    steps: Sequence[Step]  # T
    lineage: Lineage  # T
    component: Component  # after these keyframes
    expected_births: float  # in these keyframes
    is_parted: bool = False  # every object was seen in one stretch alone: see ``stretches``

    def best(self, count: int, taken: Collection[int]) -> list[Placement]:
        """At most ``count`` placements, most promising first; a start near one already ``taken`` counts as that one."""
        if len(self._ids) < LEAST_OBJECTS:
            return []
        fits = self._fitting().best(MOST_FITS)
        if not fits:
            return []
        scores = self._scores(fits)
        found: dict[tuple[int, tuple[tuple[int, int], ...]], Placement] = {}
        for number in np.argsort(-scores, kind="stable").tolist():
            start = self.starts.nearest(se2.compose(fits[number].T_map_own, self.starts.mean), taken)
            of_start = sum(self.problem.start_of(what[0]) == start for what in found)
            if start is not None and len(found) < count and of_start < MOST_OF_START:
                own = self._placement(fits[number], start, float(scores[number]))
                found.setdefault(own.what, own)
        return list(found.values())

    @cached_property
    def _ids(self) -> list[int]:
        """Likely existing objects that the robot has started itself."""
        known = self.component.objects
        likely = known.ids[known.existence > LEAST_EXISTENCE].tolist()
        return [n for n in likely if n not in self.component.elsewhere]

    @cached_property
    def _map_ids(self) -> list[int]:
        return sorted(self.problem.map_ids)

    @cached_property
    def _rates(self) -> DetectionRates:
        """Sensor and world settings as before the drive."""
        return DetectionRates.of(self.problem.open_world)

    @cached_property
    def _regions(self) -> list[SensorRegion]:
        region = sensor_region(self.problem.open_world).read_by(self.component.noise_settings)
        return [region.reaching(step.sensed) for step in self.steps]

    @cached_property
    def _log_intensities(self) -> Array:
        """(G,) log intensities of first detections [1/m^2], by setting."""
        clutter = self._rates.clutter_per_frame / self._regions[-1].area_m2
        return np.asarray(np.log(self._rates.probability * self._rates.birth_density + clutter))

    @cached_property
    def _map_places(self) -> tuple[Array, Array]:
        """(M, 2) positions and (M, 2, 2) covariances of the map's objects, ascending by id."""
        entries = sorted(self.problem.objects, key=lambda entry: entry.object_id)
        places = [positions(entry.prior.mean[None], entry.prior.covariance) for entry in entries]
        return np.array([place.points[0] for place in places]), np.array([place.covariance for place in places])

    @property
    def _stretches(self) -> Index:
        """(n,) stretch in which each object was first detected; 0 where objects are not split by stretch."""
        if not self.is_parted:
            return np.zeros(len(self._ids), dtype=int)
        return np.asarray(stretches(self.steps)[self._detected.argmax(axis=1)])

    def _fitting(self) -> Fitting:
        keys = [object_key(n) for n in self._ids]
        points, covariances = self._map_places

        def log_prior(motions: Array) -> Array:
            own = np.broadcast_to(self.starts.mean, motions.shape)
            return self.starts.log_density(se2.compose(motions, own))

        return Fitting(
            own=positions(self.component.states(keys), self.component.joint_covariance(keys)),
            map_points=points,
            map_covariances=covariances,
            log_new=self._log_new,
            log_prior=log_prior,
            stretches=self._stretches,
        )

    @cached_property
    def _log_new(self) -> float:
        """Log intensity of first detections [1/m^2], the reference of the fits' gains."""
        return float(np.median(self._log_intensities))

    def _scores(self, fits: Sequence[Fit]) -> Array:
        """(F,) log gains of fits."""
        known, on_map = self._of_own(), self._of_map(fits)
        births = len({n for step in self.lineage for n in step.association} - set(self._map_ids))
        lost = self._log_probability(births, known.sum(axis=0))
        scores = np.zeros(len(fits))
        for number, fit in enumerate(fits):
            left = [n for n in range(len(self._ids)) if n not in fit.names]
            placed = self._log_probability(births - len(fit.names), on_map[number] + known[left].sum(axis=0))
            scores[number] = fit.log_gain + len(fit.names) * self._log_new + placed - lost
        return scores

    def _log_probability(self, births: int, log_likelihoods: Array) -> float:
        """Log of the sum over settings of the probability of births, and of detections and misses (P,)."""
        density = self._rates.birth_density / self.component.objects.rates.moments("birth_density")[0]
        _, which = self._rates.sensors
        log_factors = births * self._log_intensities - self.expected_births * density + log_likelihoods[which]
        return float(self._rates.explained(log_factors)[0])

    @cached_property
    def _sightings(self) -> Sightings:
        return Sightings(
            path=self.component.states([robot_key(k) for k in range(len(self.steps))])[:, :3],
            regions=self._regions,
            sensors=self._rates.sensors[0],
        )

    @cached_property
    def _detected(self) -> Flags:
        """(n, T) whether each object was detected in each keyframe."""
        rows = [[number in step.association for step in self.lineage] for number in self._ids]
        return np.array(rows, dtype=bool)

    def _of_own(self) -> Array:
        """(n, P) log likelihoods of detections and misses of the robot's own objects, after the first of each."""
        points = self.component.states([object_key(n) for n in self._ids])[:, :2]
        view = self._sightings.in_view(points)
        return self._sightings.log_likelihoods(view, self._detected, self._detected.argmax(axis=1))

    def _of_map(self, fits: Sequence[Fit]) -> Array:
        """(F, P) log likelihoods of detections and misses of the map's objects, each of which may have left before."""
        points, _ = self._map_places
        poses = np.column_stack([points, np.zeros(len(points))])
        there = np.array([se2.between(np.broadcast_to(fit.T_map_own, poses.shape), poses)[:, :2] for fit in fits])
        detected = np.zeros((len(fits), len(points), len(self.steps)), dtype=bool)
        for number, fit in enumerate(fits):
            for own, on_map in fit.names.items():
                detected[number, on_map] |= self._detected[own]
        view = self._sightings.in_view(there)
        present = self._sightings.log_likelihoods(view, detected, np.full(detected.shape[:2], -1))
        log_existence, log_absence = self._log_existence
        absent = np.where(detected.any(axis=-1), -np.inf, log_absence)
        return np.asarray(np.logaddexp(log_existence[:, None] + present, absent[..., None]).sum(axis=1))

    @cached_property
    def _log_existence(self) -> tuple[Array, Array]:
        """(M,) log probabilities that the map's objects exist when the drive begins, and that they do not."""
        entries = sorted(self.problem.objects, key=lambda entry: entry.object_id)
        share = np.array([entry.existence for entry in entries]) * (1.0 - self.problem.open_world.departed_share)
        with np.errstate(divide="ignore"):
            return np.log(share), np.log1p(-share)

    def _placement(self, fit: Fit, start: int, log_gain: float) -> Placement:
        """The history from a start pose, with map objects in place of the matched ones that the robot had started."""
        names = {self._ids[own]: self._map_ids[on_map] for own, on_map in fit.names.items()}
        steps = [
            replace(step, association=tuple(names.get(number, number) for number in step.association))
            for step in self.lineage
        ]
        steps[0] = replace(steps[0], mode=self.problem.with_start(self.component.noise_index, start))
        return Placement(tuple(steps), tuple(sorted(names.items())), log_gain)

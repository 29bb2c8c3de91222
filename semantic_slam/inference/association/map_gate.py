"""Which objects of a large map a detection can be of at all: what range and bearing rule out is not enumerated.

However robot and object deviate from where they are predicted, a detection that does not fit costs evidence: the
deviation that makes it fit, or the residual. That bound says before any search what every association with an object
stays below, and after the search whether something has been left out that the gate would have kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces

FEW_OBJECTS = 12
"""Up to so many, all of them are looked at."""
FIRST_MARGIN = 15.0
"""Nats, beyond the gate, that a detection may cost more than at least: objects looked at from the start."""


@dataclass(frozen=True)
class MapGate:
    """P parents, D detections, O objects of the map."""

    cost: Array  # (P, D, O) nats that the detection costs at least if it is of the object
    log_peak: float  # log density of all detections where nothing costs anything
    admitted: Flags  # (P, D, O) what is enumerated
    has_clutter: bool = False  # a detection may be of no object, too

    def columns(self) -> Index:
        """Objects that are enumerated for some parent."""
        return np.flatnonzero(self.admitted.any(axis=(0, 1)))

    def widened(self, best: Array, gate: float) -> "MapGate | None":
        """The gate with what may be less than ``gate`` behind the parents' ``best`` (P,); None where nothing is new."""
        missed = ~self.admitted & (self.log_peak - self.cost >= (best - gate)[:, None, None])
        return replace(self, admitted=self.admitted | missed) if missed.any() else None

    def log_left_out(self, best: Array) -> Array:
        """(P,) bound on the mass of all associations with an object not admitted, relative to the best one."""
        _, detections, objects = self.cost.shape
        others = (detections - 1) * np.log(objects + self.has_clutter)  # every way to associate the other detections
        bounds = np.where(self.admitted, -np.inf, self.log_peak - self.cost - best[:, None, None])
        return np.asarray(others + np.logaddexp.reduce(bounds.reshape(len(best), -1), axis=1))


def map_gate(
    spaces: Spaces,
    model: ObservationModel,
    step: Step,
    detections: Sequence[Any],
    components: Sequence[Component],
    objects: Sequence[tuple[int, Array]],
    gate: float,
) -> MapGate:
    """Gate by the parents' predictions; ``objects`` are ids and (l, l) prior covariances, which updates only narrow."""
    keys = [object_key(number) for number, _ in objects]
    rows = spaces.landmark.position_rows
    sigmas = largest_sigmas(np.array([covariance[rows, rows] for _, covariance in objects]))
    states = np.array([component.states(keys) for component in components])[..., : spaces.storage.landmark]
    robot = np.array([component.newest_robot() for component in components])
    covariance = np.array([component.joint_covariance([robot_key(component.keyframe)]) for component in components])
    transition = spaces.robot.propagation(step.motion.control)
    covariance = transition @ covariance @ transition.T + step.motion.covariance
    robot = spaces.robot.compose(robot, step.motion.control)
    cost, log_peak = model.least_cost(model.collect(detections), robot, covariance, states, sigmas)
    needed = min(len(detections), len(objects)) - 1  # so many options for each, and distinct objects can be had
    cheapest = np.partition(cost, [0, needed], axis=2)
    admitted = cost <= np.maximum(cheapest[..., needed : needed + 1], cheapest[..., :1] + gate + FIRST_MARGIN)
    return MapGate(cost, log_peak, admitted)

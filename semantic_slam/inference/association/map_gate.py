"""Gating on a large map: objects that range and bearing rule out for a detection are not enumerated.

However robot and object deviate from their predictions, a detection that does not fit costs evidence: by the deviation
that makes it fit, or by its residual. This gives an upper bound on the evidence of every association with an object
before any search, and shows after the search whether something was left out that the enumeration gate would have kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.association.closed_prediction import predict
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.states.spaces import Spaces

FEW_OBJECTS = 12
"""Maps of at most this many objects are not gated."""
FIRST_MARGIN = 15.0
"""Initially admitted are objects whose bound is within the gate plus this many nats of a detection's best one."""


@dataclass(frozen=True)
class MapGate:
    """The gate of P parents, D detections and O objects of the map."""

    cost: Array  # (P, D, O) lower bound in nats on what the detection costs if it is of the object
    log_peak: float  # log density of all detections at zero cost
    admitted: Flags  # (P, D, O) pairs that are enumerated
    has_clutter: bool = False  # whether a detection may also be of no object
    num_alike: Index | None = None  # (P,) objects that are no option beside others like them; None: none

    def columns(self) -> Index:
        """Columns of the objects that are enumerated for some parent and detection."""
        return np.flatnonzero(self.admitted.any(axis=(0, 1)))

    def widened(self, best: Array, gate: float) -> "MapGate | None":
        """The gate with all pairs that may be within ``gate`` nats of the parents' ``best`` (P,); None: no new ones."""
        missed = ~self.admitted & (self.log_peak - self.cost >= (best - gate)[:, None, None])
        return replace(self, admitted=self.admitted | missed) if missed.any() else None

    def log_left_out(self, best: Array) -> Array:
        """(P,) upper bound on the log mass of all associations with a pair not admitted, relative to ``best`` (P,)."""
        _, detections, objects = self.cost.shape
        options = objects + self.has_clutter - (0 if self.num_alike is None else self.num_alike)
        others = (detections - 1) * np.log(options)  # every way to associate the other detections
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
    """Compute the gate from the parents' predictions; ``objects`` are ids and (l, l) prior covariances.

    Prior covariances bound the present ones, as updates only narrow them.
    """
    keys = [object_key(number) for number, _ in objects]
    rows = spaces.landmark.position_rows
    sigmas = largest_sigmas(np.array([covariance[rows, rows] for _, covariance in objects]))
    states = np.array([component.states(keys) for component in components])[..., : spaces.storage.landmark]
    robots = predict(components, step.motion, [], [])
    robot = robots.mean[:, 0, : spaces.storage.robot]
    cost, log_peak = model.least_cost(model.collect(detections), robot, robots.covariance, states, sigmas)
    needed = min(len(detections), len(objects)) - 1  # with this many options each, a distinct assignment exists
    cheapest = np.partition(cost, [0, needed], axis=2)
    admitted = cost <= np.maximum(cheapest[..., needed : needed + 1], cheapest[..., :1] + gate + FIRST_MARGIN)
    return MapGate(cost, log_peak, admitted)

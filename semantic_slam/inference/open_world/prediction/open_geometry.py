"""What an open world asks of the space that robot and objects are in: where a sensor looks, and where births are."""

from collections.abc import Sequence
from typing import Any, Protocol

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.planar.geometry import PlanarGeometry
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.spatial.geometry import SpatialGeometry
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import TrackedStates


class OpenGeometry(Protocol):
    """States are (..., s) of robot or object; a ``region`` is of the kind that :meth:`region` makes."""

    def region(self, settings: OpenWorldConfiguration) -> Any:
        """The region in which a miss counts, as configured."""

    def births(self, model: ObservationModel, detections: Sequence[Any], robot: Array, region: Any) -> list[Birth]:
        """The objects that detections start, seen from the predicted ``robot`` (s,)."""

    def expected_births(
        self,
        settings: OpenWorldConfiguration,
        component: Component,
        region: Any,
        robot: Array,
        births: list[Birth],
        detections: Sequence[Any],
        second: Array,
    ) -> tuple[Array, Array, Array]:
        """(G,) first detections expected from ``robot`` (s,), (D, G) log intensities at the detections, and existence.

        ``second`` (D, G) are intensities of second boxes of what is known.
        """

    def predicted_detections(self, region: Any, rates: DetectionRates, objects: PredictedObjects) -> Array:
        """(N, G) detection probabilities at the prediction itself, nothing being hidden."""

    def detections_at(
        self,
        region: Any,
        rates: DetectionRates,
        objects: PredictedObjects,
        robot: Array,
        covariance: Array,
        step: Step,
    ) -> Array:
        """(K, N, G) those at modes ``robot`` (K, s) with (K, r, r), where what the frame shows hides what is behind."""

    def distances(self, states: Array, robot: Array) -> Array:
        """(O,) metres of objects from a robot (s,)."""

    def ahead(self, region: Any, states: Array, robot: Array, reach: Index) -> Index:
        """(n,) rows of the objects within ``reach`` (N,) towards which the sensor looks, the nearest ones."""

    def moving_along(self, robot: Array, states: Array) -> Array:
        """(N, l, r) changes of objects that move with the robot as if they were fixed to it."""

    def sigmas_away(
        self, tracked: TrackedStates, robot: Array, spread: Array, births: list[Birth], detections: Sequence[Any]
    ) -> Array:
        """(D, O) standard deviations between detections and where each object is predicted."""

    def is_lost(self, spread: Array) -> bool:
        """Whether a predicted robot with (r, r) covariance does not tell what is in sight."""


def geometry_of(spaces: Spaces) -> OpenGeometry:
    """That of a robot and its objects."""
    return SpatialGeometry(spaces) if spaces.name == "spatial" else PlanarGeometry()

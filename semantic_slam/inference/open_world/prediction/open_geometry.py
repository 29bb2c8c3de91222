"""Interface of open-world geometry, planar or spatial: the sensor's region, births, and detection probabilities."""

from collections.abc import Sequence
from typing import Any, Protocol

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.planar.geometry import PlanarGeometry
from semantic_slam.inference.open_world.predicted_objects import PredictedObjects
from semantic_slam.inference.open_world.seen_again import SeenAgain
from semantic_slam.inference.open_world.spatial.geometry import SpatialGeometry
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.in_view import PredictedDetections
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import TrackedStates


class OpenGeometry(Protocol):
    """States are (..., s) of robot or object; a ``region`` is of the type that :meth:`region` returns."""

    def region(self, settings: OpenWorldConfiguration) -> Any:
        """The sensor's region, in which a missed detection counts, as configured."""

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
        """(G,) expected first detections from ``robot`` (s,), (D, G) log intensities at detections, and existence.

        ``second`` (D, G): intensities of duplicate boxes of known objects.
        """

    def predicted_detections(
        self, region: Any, rates: DetectionRates, objects: PredictedObjects
    ) -> PredictedDetections:
        """Predicted detections of the N objects from the predicted robot (K = 1), without occlusion."""

    def detections_at(
        self,
        region: Any,
        rates: DetectionRates,
        objects: PredictedObjects,
        robot: Array,
        covariance: Array,
        step: Step,
        seen: SeenAgain,
    ) -> tuple[PredictedDetections, Array]:
        """Predicted detections of the N objects from modes ``robot`` (K, s) with covariances (K, r, r), with occlusion.

        With the (n, G) detection probabilities of the objects ``seen``, given their detections.
        """

    def distances(self, states: Array, robot: Array) -> Array:
        """(O,) distances [m] of objects from a robot (s,)."""

    def ahead(self, region: Any, states: Array, robot: Array, reach: Index) -> Index:
        """(n,) rows of the nearest objects within ``reach`` (N,) in the direction that the sensor looks."""

    def moving_along(self, robot: Array, states: Array) -> Array:
        """(N, l, r) Jacobians of objects by the robot, as if they were fixed to it."""

    def sigmas_away(
        self, tracked: TrackedStates, robot: Array, spread: Array, births: list[Birth], detections: Sequence[Any]
    ) -> Array:
        """(D, O) distances in standard deviations between detections and predicted objects."""


def geometry_of(spaces: Spaces) -> OpenGeometry:
    """The open-world geometry of some state spaces."""
    return SpatialGeometry(spaces) if spaces.name == "spatial" else PlanarGeometry()

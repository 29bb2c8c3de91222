"""What the null model needs of a state space: where detections may lie, with equal density everywhere."""

from collections.abc import Sequence
from typing import Any, Protocol, Self

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.detection_rates import DetectionRates


class EvenPlaces(Protocol):
    """Uniform geometric measurements over the sensor's region."""

    def suits(self, detections: Sequence[Any]) -> bool:
        """Whether the region is defined for the measurements of these detections."""

    def reaching(self, step: Step) -> Self:
        """The places as a keyframe has them, whose region may be learned."""

    def log_density(self, step: Step, used: Sequence[int]) -> float:
        """Log density of the geometric measurements of the detections ``used``, in nats."""

    def log_density_of_first(self, detection: Any) -> float:
        """Log density of the first detection of a named object, under the object's prior, which is centred on it."""

    def visible(self, belief: HybridBelief) -> Flags:
        """(O,) whether each of the belief's objects is visible from the pose of the heaviest hypothesis."""

    def expected_births(self, rates: DetectionRates) -> Array:
        """(G,) first detections expected where nothing was seen yet."""

    def log_motion(self, step: Step) -> float:
        """Log density of what is measured of the robot's motion beside odometry, in nats; once per keyframe."""

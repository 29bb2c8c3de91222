"""Drives whose steps are made by hand, past the messages of a robot."""

from collections.abc import Sequence
from dataclasses import dataclass

from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.step import Step


@dataclass(frozen=True)
class PreparedSteps:
    """Reader of keyframes that say no more than which step is next."""

    steps: Sequence[Step]

    def step(self, keyframe: Keyframe) -> Step:
        """Step of that number."""
        return self.steps[keyframe.index]

"""Why a hypothesis has to be given up."""

from collections.abc import Sequence

from semantic_slam.errors import SemanticSlamError


class LostComponentError(SemanticSlamError):
    """A component's linear system is indeterminate; its hypothesis has to be given up."""


class UnknownObjectsError(LostComponentError):
    """A lineage names objects that its hypothesis does not know, or not near by."""

    def __init__(self, object_ids: Sequence[int]) -> None:
        super().__init__("a lineage names an object that its hypothesis does not know")
        self.object_ids = object_ids


class ConsumedSmootherError(Exception):
    """A smoother was asked after an update had consumed it: a mistake in the program, not in its data."""


def first_line(fault: BaseException) -> str:
    """What GTSAM says, in short."""
    return next((line for line in str(fault).splitlines() if line.strip()), type(fault).__name__)

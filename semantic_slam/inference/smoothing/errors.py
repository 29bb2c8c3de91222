"""Errors of smoothing, above all those for which a hypothesis has to be dropped."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from semantic_slam.errors import SemanticSlamError


class LostComponentError(SemanticSlamError):
    """A component's linear system is indeterminate; its hypothesis has to be dropped."""


class UnknownObjectsError(LostComponentError):
    """A lineage names objects that its hypothesis does not know, or that are not near."""

    def __init__(self, object_ids: Sequence[int]) -> None:
        super().__init__("a lineage names an object that its hypothesis does not know")
        self.object_ids = object_ids


class ConsumedSmootherError(Exception):
    """A smoother was used after an update had consumed it: a programming error, not one of the data."""


@contextmanager
def lost_where_indeterminate(what: str) -> Iterator[None]:
    """Turns GTSAM's error on an unsolvable system into LostComponentError, saying that ``what`` failed.

    GTSAM throws RuntimeError. An error in a model that a user supplies is not one of GTSAM's, and passes through.
    """
    try:
        yield
    except (NotImplementedError, RecursionError):
        raise
    except RuntimeError as fault:
        raise LostComponentError(f"{what} failed ({first_line(fault)})") from None


def first_line(fault: BaseException) -> str:
    """The first line of GTSAM's message."""
    return next((line for line in str(fault).splitlines() if line.strip()), type(fault).__name__)

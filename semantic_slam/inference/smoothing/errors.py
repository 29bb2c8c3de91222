"""Why a hypothesis has to be given up."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

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


@contextmanager
def lost_where_indeterminate(what: str) -> Iterator[None]:
    """GTSAM's complaint about a system that cannot be solved, as LostComponentError: ``what`` failed.

    GTSAM throws RuntimeError; a mistake in a model that a user brings is not one of its complaints, and is let through.
    """
    try:
        yield
    except (NotImplementedError, RecursionError):
        raise
    except RuntimeError as fault:
        raise LostComponentError(f"{what} failed ({first_line(fault)})") from None


def first_line(fault: BaseException) -> str:
    """What GTSAM says, in short."""
    return next((line for line in str(fault).splitlines() if line.strip()), type(fault).__name__)

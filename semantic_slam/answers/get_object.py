"""``get_object``: all that a belief knows of one object; used by the command and the service."""

from dataclasses import dataclass

from semantic_slam.answers.rows import row_named, row_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.belief_views import ObjectEstimate


@dataclass(frozen=True, kw_only=True)
class KnownObject(ObjectEstimate):
    """All that a belief knows of an object; what the run did not estimate is NaN."""

    moving: float  # probability that it moves, given that it exists
    moved: float  # probability that it stood elsewhere when it was mapped
    missing: float  # probability that it existed, and is gone
    mutual_information: float  # nats, the epistemic part of the uncertainty of its class
    in_coverage: bool  # no more views lay outside the class models' coverage than false alarms explain


def get_object(belief: HybridBelief, which: int | str) -> KnownObject:
    """All that the belief knows of one object, given by its number or its name. Raises InputError if there is none.

    A text means the object of that name; if there is none, the one with that number.
    """
    row = row_named(belief, which) if isinstance(which, str) else row_of(belief, which)
    return KnownObject(
        **vars(belief.objects[row]),
        moving=float(belief.moving[row]),
        moved=float(belief.moved[row]),
        missing=float(belief.missing[row]),
        mutual_information=float(belief.mutual_information[row]),
        in_coverage=bool(belief.in_coverage[row]),
    )

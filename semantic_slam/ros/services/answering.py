"""Helpers for the hypothesis manager's services, which answer from the newest belief or with a fault text."""

from collections.abc import Callable
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief

Handler = Callable[[Any, Any], Any]


def answering(fill: Callable[[Any, Any], None]) -> Handler:
    """Service handler that calls ``fill``; an InputError's text goes into the response's field ``fault``."""

    def answer(request: Any, response: Any) -> Any:
        try:
            fill(request, response)
        except InputError as fault:
            response.fault = str(fault)
        return response

    return answer


def newest(belief: HybridBelief | None) -> HybridBelief:
    """The given belief. Raises InputError if it is None, before the first one."""
    if belief is None:
        raise InputError("there is no belief yet; ask after the first keyframe")
    return belief


def row_of(belief: HybridBelief, object_id: int) -> int:
    """Row of an object in a belief. Raises InputError for an unknown id."""
    rows = np.flatnonzero(belief.object_ids == object_id)
    if not len(rows):
        known = ", ".join(map(str, belief.object_ids.tolist())) or "none"
        raise InputError(f"object {object_id} is not on the map, which has {known}; ask for one of these")
    return int(rows[0])

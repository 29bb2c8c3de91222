"""Helpers for the hypothesis manager's services, which answer from the newest belief or with a fault text."""

from collections.abc import Callable
from typing import Any

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

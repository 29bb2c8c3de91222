"""Handlers of the hypothesis manager's services, which answer with what was asked for or with a fault text."""

from collections.abc import Callable
from typing import Any

from semantic_slam.errors import InputError

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

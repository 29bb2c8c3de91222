"""A backend in a process of its own: ``python -m semantic_slam.inference.processes.backend_process NUMBER SOCKET``.

SOCKET is the file descriptor, inherited, on which questions come; the process ends when that is closed.
"""

import sys
import time
from multiprocessing.connection import Connection
from typing import Any

from semantic_slam.child_process import with_traceback
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.processes.questions import Answer, Question


def serve(number: int, connection: Connection) -> None:
    """Answer the questions that come over ``connection`` until it is closed."""
    backend = Backend(number)
    try:
        while True:
            connection.send(answered(backend, connection.recv()))
    except (EOFError, OSError):
        return


def answered(backend: Backend, question: Question) -> Answer:
    """The answer to a question; what the backend raises is handed over, to be raised by the one who asks."""
    began = time.process_time()
    value: Any = None
    fault: Exception | None = None
    try:
        value = getattr(backend, question.name)(question.argument)
    except Exception as error:
        fault = with_traceback(error)
    return Answer(value, time.process_time() - began, fault)


if __name__ == "__main__":
    serve(int(sys.argv[1]), Connection(int(sys.argv[2])))

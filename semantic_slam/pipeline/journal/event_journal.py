"""Journal of the events that a hypothesis manager's beliefs depend on, each handled after it is recorded.

Events are messages, by their topics, and service calls and the end of a replay, by the names below. A restarted manager
handles the recorded ones again, and is then where the last process stopped.
"""

from collections.abc import Callable, Iterator, Mapping

from semantic_slam.errors import InputError
from semantic_slam.pipeline.journal.journal import NoJournal
from semantic_slam.pipeline.journal.segment import Record

END = "end"
"""The end of a replay; events after it belong to another session."""
RESTART = "restart"
"""A manager has handled all events of the journal again; what came until then, it has missed."""
SESSION, PAUSE, CHANGE = "session", "pause", "change"
"""Service calls: a run ended, with the map of the next one; a pause, b"1", or its end, b"0"; parameters that were set,
a JSON object."""


class EventJournal:
    """Events by name in a journal, with what handles them."""

    def __init__(self, journal: NoJournal, handlers: Mapping[str, Callable[[bytes], None]]) -> None:
        """``handlers`` of the events' data, by name; those of topics are added by :meth:`listen`."""
        self._journal, self._handlers = journal, dict(handlers)

    def listen(self, topic: str, handle: Callable[[bytes], None]) -> None:
        """Have ``handle`` called with each serialised message of a topic."""
        self._handlers[topic] = handle

    def record(self, name: str, data: bytes = b"") -> None:
        """Record an event that the caller handles."""
        self._journal.append(name, data)

    def happen(self, name: str, data: bytes = b"") -> None:
        """Record an event and handle it."""
        self.record(name, data)
        self._handlers[name](data)

    def past(self) -> Iterator[Record]:
        """Recorded events that are not handled yet; each must be handled before the next is asked for."""
        while self._journal.next is not None:
            yield self._journal.take()

    def happen_again(self, event: Record) -> None:
        """Handle a recorded event. Raises InputError for a record that is none, as an answer where none is due."""
        if event.name not in self._handlers:
            raise InputError(f"parameter journal: it goes on with {event.name} where no answer is due; remove it")
        self._handlers[event.name](event.data)

    def recovered(self, num_keyframes: int) -> None:
        """Say, where the journal was damaged, to which keyframe the run has gone back."""
        self._journal.recovered(num_keyframes)

    def sync(self) -> None:
        """Flush what is recorded to disk, so that it survives a power cut."""
        self._journal.sync()

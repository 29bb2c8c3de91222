"""Snapshots with which a manager's journal begins anew, so that file and restart do not grow with the drive."""

from collections.abc import Callable
from typing import Any

from semantic_slam.configuration import HistoryConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.pipeline.journal.journal import NoJournal


class Snapshots:
    """Takes a snapshot once in as many keyframes as the horizon has; none without a horizon, or without a journal."""

    def __init__(self, journal: NoJournal, history: HistoryConfiguration) -> None:
        self._journal = journal
        self._every = history.horizon_keyframes if journal.folder is not None else 0
        self._since = 0  # keyframes since the newest snapshot
        self.fault = ""  # why the newest one could not be taken; "" if it was

    @property
    def are_on(self) -> bool:
        """Whether snapshots are taken."""
        return self._every > 0

    def count(self) -> None:
        """Count a keyframe."""
        self._since += 1

    def pass_by(self, _: bytes = b"") -> None:
        """Begin to count at a snapshot, one that is in the journal or one that is taken now."""
        self._since = 0

    @property
    def is_due(self) -> bool:
        """Whether a snapshot is due."""
        return 0 < self._every <= self._since

    def take(self, state: Callable[[], Any]) -> None:
        """Begin the journal anew with a state; where that fails, it goes on as it is, and ``fault`` says so."""
        self.pass_by()
        try:
            self._journal.begin_anew(packed(state()))
        except (OSError, TypeError) as fault:
            self.fault = f"the journal goes on growing: {getattr(fault, 'strerror', None) or fault}"
        else:
            self.fault = ""

    @property
    def first(self) -> Any:
        """The state from which the journal's records go on; None: from the start. Raises InputError."""
        if not self._journal.snapshot:
            return None
        try:
            return unpacked(self._journal.snapshot)
        except ValueError as fault:
            raise InputError(f"{self._journal.folder}: {fault}; remove the journal and run again") from None

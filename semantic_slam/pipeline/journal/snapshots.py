"""Snapshots with which a manager's journal begins anew, so that file and restart do not grow with the drive."""

from typing import Any, Protocol

from semantic_slam.configuration import HistoryConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.inference.protocol import BackendPool
from semantic_slam.pipeline.journal.journal import NoJournal
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.pipeline.journal.kept_runs import KeptRuns
from semantic_slam.pipeline.session import Session
from semantic_slam.state import restore, state_of


class KeepingPool(Protocol):
    """Backend pool that keeps the keyframes of the run."""

    backend_ids: tuple[int, ...]
    runs: KeptRuns
    kept: KeptRun  # once a run has begun


class Snapshots:
    """Takes a snapshot once in as many keyframes as the horizon has; none without a horizon, or without a journal.

    A snapshot holds the state of the manager, of its session, and of what ``pool`` keeps. It is taken between two
    events, and waits while the session cannot be stored, as some history is under way: then the journal goes on as it
    is.
    """

    def __init__(self, journal: NoJournal, history: HistoryConfiguration, pool: KeepingPool) -> None:
        """Have ``pool`` keep keyframes beside the journal, if snapshots are taken."""
        self._journal, self._pool = journal, pool
        self._every = history.horizon_keyframes if journal.folder is not None else 0
        self._since = 0  # keyframes since the newest snapshot
        self.fault = ""  # why the newest one could not be taken; "" if it was
        pool.runs = KeptRuns(journal.folder if self._every else None)

    def count(self) -> None:
        """Count a keyframe."""
        self._since += 1

    def take(self, manager: Any, session: Session) -> None:
        """Begin the journal anew with the state of a manager, if that is due; where it fails, ``fault`` says why."""
        if not 0 < self._every <= self._since or not session.may_be_stored or self._pool.kept.fault:
            return
        try:
            self._journal.begin_anew(packed(self._state(manager, session)))
        except (OSError, TypeError) as fault:
            self._since, reason = 0, getattr(fault, "strerror", None) or fault
            self.fault = f"the journal grows on, as no snapshot could be taken ({reason})"
        else:
            self.fault = ""
            self.pass_by(session)

    def _state(self, manager: Any, session: Session) -> dict[str, Any]:
        kept = self._pool.kept
        kept.sync()
        return {
            "manager": state_of(manager),
            "session": session.state(),
            "backend_ids": self._pool.backend_ids,
            "kept_bytes": kept.length,
        }

    def pass_by(self, session: Session) -> None:
        """Count from here, where a snapshot was taken, and drop what no snapshot before needs."""
        self._since = 0
        self._pool.runs.pass_snapshot(session.run.run_id)

    def restore(self, manager: Any, session: Session, pool: BackendPool) -> None:
        """Give a manager and its session the state from which the journal's records go on, if it has one.

        ``pool`` is that of the session. Raises InputError for a state of another version.
        """
        if not self._journal.snapshot:
            return
        try:
            state = unpacked(self._journal.snapshot)
            restore(manager, state["manager"])
            self._pool.runs.go_on(state["session"]["run"].run_id, state["kept_bytes"])
            session.restore(state["session"], pool)
            self._pool.backend_ids = state["backend_ids"]
        except (LookupError, ValueError, TypeError, AttributeError) as fault:
            raise InputError(
                f"{self._journal.folder}: no journal of this version ({fault}); remove it and run again"
            ) from None
        self.pass_by(session)

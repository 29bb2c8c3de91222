"""Where the keyframes of each run are kept: in nameless files, or in files that a restarted manager finds again."""

import os
from collections import deque
from functools import cached_property
from pathlib import Path

from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.states.identity import digest
from semantic_slam.nameless_file import NamelessFile
from semantic_slam.pipeline.journal.kept_run import KeptRun

PREFIX = "keyframes."
"""Begins the names of the files; the digest of the run's id follows."""


class NamedFile(NamelessFile):
    """Append-only file of which the first ``length`` bytes are kept."""

    def __init__(self, path: Path, length: int) -> None:
        """Raises OSError where there are fewer bytes."""
        super().__init__()
        self._path, self.length = path, length
        if os.fstat(self.descriptor).st_size < length:
            raise FileNotFoundError(f"{path} has fewer than {length} bytes")
        os.ftruncate(self.descriptor, length)

    @cached_property
    def descriptor(self) -> int:
        """File descriptor. Raises OSError."""
        return os.open(self._path, os.O_RDWR | os.O_CREAT, 0o644)


class KeptRuns:
    """Begins to keep runs, one after the other."""

    def __init__(self, folder: Path | None = None) -> None:
        """``folder`` of the files; None: they are nameless."""
        self._folder = folder
        self._lengths: dict[str, int] = {}
        self._stored: deque[str] = deque(maxlen=2)  # runs of the last two snapshots

    def go_on(self, run_id: str, length: int) -> None:
        """Have the run with this id go on from the first ``length`` bytes of its file when it begins again."""
        self._lengths[run_id] = length

    def begin(self, run: RunConfiguration) -> KeptRun:
        """Keep this run; where its file is not as it should be, ``fault`` says so."""
        if self._folder is None:
            return KeptRun(run)
        length = self._lengths.pop(run.run_id, 0)
        try:
            return KeptRun(run, NamedFile(self._place(run.run_id), length))
        except OSError as fault:
            kept = KeptRun(run)
            kept.fault = f"the keyframes of this run are not there again ({fault.strerror or fault})"
            return kept

    def pass_snapshot(self, run_id: str) -> None:
        """Remove the files of runs that have ended before the last two snapshots; ``run_id`` is that of the newest."""
        self._stored.append(run_id)
        if self._folder is None:
            return
        kept = {self._place(own) for own in self._stored}
        for place in self._folder.glob(f"{PREFIX}*"):
            if place not in kept:
                place.unlink(missing_ok=True)

    def _place(self, run_id: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{PREFIX}{digest(run_id)}"

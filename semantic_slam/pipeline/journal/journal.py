"""Journal on disk of what a hypothesis manager received, by which a restarted one replays and continues the run.

A belief is a function of the configuration, the received messages in order, and the backends' answers. A record is
passed to the operating system at once, and reaches the disk with :meth:`Journal.sync`. A record torn by a power cut is
truncated at the next start. Where whole records follow behind one that is not, the file is damaged: it is kept under
another name, and the run goes on from what is before the damage.

A journal that :meth:`begins anew <Journal.begin_anew>` has two files: ``journal``, and ``journal.next``, which goes on
from its end. The first record of a file is the run; in one that was begun anew the second one is a snapshot, the
manager's state at that point. Records are numbered through both, so that none is missing in between. A restarted
manager takes the snapshot of the older file and replays both: what it publishes again reaches back at least as far as
the newer one. A new file is written aside, synced and only then renamed, so that a kill at any instant leaves a whole
journal:

======================================  ==================================================
killed while                            is left
======================================  ==================================================
``journal.new`` is written              ``journal``, ``journal.next``: as before
``journal.next`` replaces ``journal``   ``journal``: it goes on there
``journal.new`` replaces the other      ``journal``, ``journal.next``: begun anew
======================================  ==================================================
"""

import fcntl
import os
import shutil
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path

from semantic_slam.errors import InputError
from semantic_slam.pipeline.journal.run_difference import difference
from semantic_slam.pipeline.journal.segment import Record, Segment, sync_folder

FILE, NEXT_FILE, NEW_FILE, LOCK_FILE = "journal", "journal.next", "journal.new", "journal.lock"
OLD_SUFFIX = ".old"
DAMAGED_SUFFIX = ".damaged_"
RUN = "run"
"""Name of the first record of a file, whose data identify the run."""
SNAPSHOT = "snapshot"
"""Name of the second record of a file that was begun anew, whose data are the state at that point."""


class NoJournal:
    """Null journal: it is empty and discards what is appended."""

    snapshot: bytes = b""
    """State from which the records go on; empty: from the start of the run."""

    @property
    def folder(self) -> Path | None:
        """Where the journal is; None: nowhere."""
        return None

    @property
    def is_damaged(self) -> bool:
        """Whether records behind those on disk were lost to damage: others may know what came of them."""
        return False

    @property
    def next(self) -> Record | None:
        """The oldest record not taken yet; None if all were taken."""
        return None

    def take(self) -> Record:
        """Take the oldest record not taken yet. Raises InputError if there is none."""
        raise InputError("there is no journal to go on from; set parameter journal")

    def append(self, name: str, data: bytes = b"") -> None:
        """Append a record; all records on disk must have been taken before."""

    def begin_anew(self, snapshot: bytes) -> None:
        """Go on in a new file from the state ``snapshot``, and drop the file before the present one. Raises OSError."""

    def sync(self) -> None:
        """Flush appended records to disk, so that they survive a power cut."""

    def recovered(self, num_keyframes: int) -> None:
        """Say, if the journal was damaged, from which keyframe its run goes on; all records were taken."""


def to_stderr(line: str) -> None:
    """Print a line on what is torn or damaged."""
    print(line, file=sys.stderr)


class Journal(NoJournal):
    """Journal of one run in a folder, locked by one process at a time."""

    def __init__(self, folder: Path, run: str, *, resume: bool = True, say: Callable[[str], None] = to_stderr) -> None:
        """``run`` identifies the run; ``resume`` False: rename an old journal to journal.old. Raises InputError.

        ``say`` is called with a line on what is torn or damaged.
        """
        self._folder, self._run, self._say = folder, run, say
        self._damaged: Path | None = None  # copy of a file that was damaged
        self._path = folder / FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = self._locked()
            (folder / NEW_FILE).unlink(missing_ok=True)
            if not resume:
                self._set_aside()
            self._files = [Segment(place) for place in (self._path, folder / NEXT_FILE) if _is_due(place)]
        except OSError as fault:
            raise InputError(f"{self._path}: cannot be written ({fault.strerror}); name another journal") from None
        try:
            self.snapshot = self._begun()
            self._next = self._read()
        except InputError:
            self.close()
            raise

    def _locked(self) -> int:
        lock = os.open(self._folder / LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            raise InputError(f"{self._path}: another process goes on from it; end that one first") from None
        return lock

    def _set_aside(self) -> None:
        for place in (self._path, self._folder / NEXT_FILE):
            if place.exists():
                os.replace(place, place.with_name(place.name + OLD_SUFFIX))

    def _begun(self) -> bytes:
        """Read the beginnings of the files; the snapshot of the first of them. Raises InputError."""
        *older, newest = self._files
        begins_at, snapshot = newest.number, self._beginning(newest)
        for file in older:
            if _is_whole(file.path, begins_at):
                return self._beginning(file)
            self._say(f"{file.path}: is damaged; the run goes on from {newest.path.name} alone")
            file.close()
            self._files.remove(file)
        return snapshot

    def _beginning(self, file: Segment) -> bytes:
        """Read the first records of a file; its snapshot, empty if it has none. Raises InputError."""
        number, first = file.number, file.read()
        if first is None and number == 0 and file.size < Segment.size_of(RUN, self._run.encode()):
            self._cut_off(file)
            file.append(RUN, self._run.encode())
            file.sync()
            sync_folder(self._folder)
            return b""
        if first is not None and first != Record(RUN, self._run.encode()):
            told = (
                difference(first.data.decode("utf-8", "replace"), self._run) if first.name == RUN else "no first record"
            )
            raise InputError(
                f"{file.path}: is of another run ({told}): restore that, name another journal, or set this one aside by"
                " resume:=false"
            )
        second = Record(SNAPSHOT, b"") if number == 0 else file.read()
        if first is None or second is None or second.name != SNAPSHOT:
            raise InputError(f"{file.path}: its beginning is damaged; remove it, and what came since is lost")
        return second.data

    @property
    def folder(self) -> Path | None:
        return self._folder

    @property
    def is_damaged(self) -> bool:
        return self._damaged is not None

    @property
    def next(self) -> Record | None:
        return self._next

    def take(self) -> Record:
        record = self._next
        if record is None:
            raise InputError(f"{self._path}: ends too early; remove it and run again")
        self._next = self._read()
        return record

    def _read(self) -> Record | None:
        """Read the next record; None at the end, where a torn record is truncated."""
        file = self._files[0]
        record = file.read()
        if record is None and file is not self._files[-1]:
            file.close()
            del self._files[0]
            return Record(SNAPSHOT, b"")
        if record is None:
            self._cut_off(file)
        return record

    def _cut_off(self, file: Segment) -> None:
        """Truncate a file behind its whole records; one that is damaged is copied before. Raises InputError."""
        if not file.num_torn:
            return
        if file.is_damaged:
            self._damaged = _kept(file.path)
            text = f"damaged at byte {file.num_read} of {file.size}; it is kept as {self._damaged.name}"
            self._say(f"{file.path}: {text}, and the run goes back to what is before that byte")
        else:
            self._say(f"{file.path}: its last {file.num_torn} bytes are torn; they are cut off")
        file.cut_off()

    def recovered(self, num_keyframes: int) -> None:
        if self._damaged is not None:
            where = f"keyframe {num_keyframes - 1}" if num_keyframes else "its start"
            self._say(
                f"{self._path}: the run goes on from {where}, as the journal was damaged behind it; for a run without"
                " that gap start this node again with resume:=false"
            )

    def append(self, name: str, data: bytes = b"") -> None:
        self._check_taken(name)
        self._files[-1].append(name, data)

    def _check_taken(self, name: str) -> None:
        if self._next is not None:
            raise ValueError(f"{self._path}: {name} was appended before all records were taken")

    def begin_anew(self, snapshot: bytes) -> None:
        self._check_taken(SNAPSHOT)
        (former,) = self._files
        former.sync()
        place, new = self._folder / NEXT_FILE, self._folder / NEW_FILE
        new.unlink(missing_ok=True)
        file = Segment(new)
        file.number = former.number
        try:
            file.append(RUN, self._run.encode())
            file.append(SNAPSHOT, snapshot)
            file.sync()
            if former.path == place:
                former.move_to(self._path)
            file.move_to(place)
        except OSError:
            file.close()
            raise
        former.close()
        self._files = [file]
        sync_folder(self._folder)

    def sync(self) -> None:
        self._files[-1].sync()

    def close(self) -> None:
        """Close the files and release the lock."""
        for file in self._files:
            file.close()
        os.close(self._lock)


def _is_due(place: Path) -> bool:
    """Whether a file is to be opened: the first one always, another one if it is there."""
    return place.name == FILE or place.exists()


def _kept(path: Path) -> Path:
    """Copy a damaged file under a name that is free. Raises InputError."""
    names = (path.with_name(f"{path.name}{DAMAGED_SUFFIX}{n:03}") for n in count())
    copy = next(name for name in names if not name.exists())
    try:
        shutil.copyfile(path, copy)
    except OSError as fault:
        copy.unlink(missing_ok=True)
        raise InputError(
            f"{path}: is damaged, and cannot be kept as {copy.name} ({fault.strerror}); free space there, or move it"
            " away"
        ) from None
    return copy


def _is_whole(path: Path, end: int) -> bool:
    """Whether a file's records are whole, up to one before number ``end``."""
    file = Segment(path)
    try:
        while file.read() is not None:
            pass
        return file.number == end and not file.num_torn
    finally:
        file.close()

"""Checkpoints that are files, too: a backend that is started again, or another one of this host, goes on from them.

The name of a file and the key of its digest are those of all that its component depends on: the run, the content of the
keyframes, the hypothesis, and the versions of the software. A file of anything else is not found or not believed.
"""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from hashlib import blake2b
from importlib.metadata import version
from pathlib import Path

from semantic_slam.configuration import HistoryConfiguration
from semantic_slam.inference.checkpoints.records import packed
from semantic_slam.inference.checkpoints.stored_component import restored, stored
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.past.horizon import apart
from semantic_slam.inference.smoothing.trunks import MOST, Trunks
from semantic_slam.inference.states.identity import digest
from semantic_slam.run_folder import RunFolder
from semantic_slam.version import __version__

VERSIONS = (__version__, version("gtsam"), version("numpy"))
DIGEST_SIZE = 32
SUFFIX = ".checkpoint"


class StoredTrunks(Trunks):
    """Checkpoints in memory and in the folder of a run; call :meth:`learn` with each of its keyframes, in order."""

    def __init__(self, apart: int, run_id: str, make_root: Callable[[], Component]) -> None:
        """``make_root`` makes a root component of the run's problem."""
        super().__init__(apart)
        self.folder = folder_of(run_id)
        self._ignored: Counter[str] = Counter()
        self._run_id, self._make_root = run_id, make_root
        self._keyframes = blake2b(digest_size=16)
        self._num_keyframes = 0
        self._digests: dict[int, str] = {}  # of the first keyframes, by their number, where a checkpoint may be

    def learn(self, step: Step) -> None:
        """Note the content of the next keyframe."""
        try:
            self._keyframes.update(packed(step))
        except TypeError as fault:
            self.folder.fault = str(fault)
        self._num_keyframes += 1
        if self.is_due(self._num_keyframes):
            self._digests[self._num_keyframes] = self._keyframes.hexdigest()

    def keep(self, number: int, component: Component) -> None:
        """Keep a checkpoint, and write it to a file if it is one of the newest and has marginalised poses."""
        super().keep(number, component)
        if component.past and not self.folder.fault and component.keyframe + 1 > self._oldest_stored:
            try:
                self._write(number, component)
            except (OSError, TypeError) as fault:
                self._ignored[f"cannot be stored ({getattr(fault, 'strerror', None) or fault})"] += 1
            self._remove_old()

    def deepest(self, numbers: Sequence[int]) -> tuple[int, Component] | None:
        """The last checkpoint along a lineage of hypothesis ids, in memory or in a file: its index, and component."""
        found = super().deepest(numbers)
        first = 0 if found is None else found[0]
        for at in reversed(range(max(first, self._oldest_stored, 0) + 1, len(numbers))):
            if self.is_due(at) and (component := self._read(at, numbers[at])) is not None:
                super().keep(numbers[at], component)
                return at, component
        return found

    def close(self) -> None:
        """Leave the folder; the last node of the run removes it."""
        self.folder.leave()

    @property
    def faults(self) -> Counter[str]:
        """Files that were not believed, and checkpoints that could not be stored, by reason."""
        no_folder = Counter({f"{self.folder.path}: {self.folder.fault}": 1}) if self.folder.fault else Counter[str]()
        return self._ignored + no_folder

    @property
    def _oldest_stored(self) -> int:
        """Number of keyframes up to which files are obsolete."""
        return self._num_keyframes - MOST * self._apart

    def _key(self, count: int, number: int) -> bytes:
        """Digest of all that the component of a hypothesis after ``count`` keyframes depends on."""
        return blake2b(repr((VERSIONS, self._run_id, number, count, self._digests[count])).encode()).digest()

    def _path(self, count: int, key: bytes) -> Path:
        return self.folder.path / f"{count:09d}_{key.hex()[:32]}{SUFFIX}"

    def _write(self, number: int, component: Component) -> None:
        """Write a file, whole or not at all. Raises OSError or TypeError."""
        key = self._key(component.keyframe + 1, number)
        path = self._path(component.keyframe + 1, key)
        if path.exists():
            return
        data = stored(component)
        unfinished = path.with_suffix(f".{os.getpid()}")
        unfinished.write_bytes(blake2b(data, digest_size=DIGEST_SIZE, key=key).digest() + data)
        unfinished.replace(path)

    def _read(self, count: int, number: int) -> Component | None:
        """The component of a file; None if there is none, or none to be believed, which is counted."""
        key = self._key(count, number)
        path = self._path(count, key)
        try:
            told, data = _parted(path.read_bytes())
            if blake2b(data, digest_size=DIGEST_SIZE, key=key).digest() != told:
                raise ValueError("a damaged file")
            return restored(data, self._make_root())
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as fault:
            self._ignored[getattr(fault, "strerror", None) or str(fault)] += 1
            path.unlink(missing_ok=True)
            return None

    def _remove_old(self) -> None:
        with suppress(OSError, ValueError):
            for path in self.folder.path.iterdir():
                if int(path.name.partition("_")[0]) <= self._oldest_stored:
                    path.unlink(missing_ok=True)


def _parted(data: bytes) -> tuple[bytes, bytes]:
    """The digest at the beginning of a file, and the rest."""
    return data[:DIGEST_SIZE], data[DIGEST_SIZE:]


def folder_of(run_id: str) -> RunFolder:
    """Enter the folder with the checkpoints of a run."""
    return RunFolder(digest(run_id))


def trunks_of(
    history: HistoryConfiguration, run_id: str, make_root: Callable[[], Component], *, stores: bool
) -> Trunks:
    """Checkpoints for a run; ``stores``: in files, too, if old poses are marginalised."""
    if not history.is_on:
        return Trunks()
    return StoredTrunks(apart(history), run_id, make_root) if stores else Trunks(apart(history))

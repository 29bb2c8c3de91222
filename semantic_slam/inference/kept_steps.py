"""Storage of the keyframes that a backend may have to replay: all, or those since its oldest checkpoint."""

import pickle
from array import array
from collections import deque

from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.nameless_file import NamelessFile


class KeptSteps:
    """Steps by keyframe, and the stamps of all keyframes, which enter the ids of hypotheses."""

    def __init__(self, in_memory: int | None = None) -> None:
        """``in_memory``: number of steps kept in memory; older ones go to disk unless it is full. None: all stay."""
        self.stamps_ns = array("q")
        self.disk_fault = ""  # system's error message if steps can no longer be written to disk, else ""
        self._in_memory = in_memory
        self._kept: deque[Step] = deque()
        self._disk = NamelessFile()
        self._ends = array("q", [0])  # byte offset on disk where each step ends

    def __len__(self) -> int:
        """Number of keyframes so far, including those that are forgotten."""
        return len(self.stamps_ns)

    @property
    def num_on_disk(self) -> int:
        """Number of keyframes on disk; these are the oldest ones."""
        return len(self._ends) - 1

    @property
    def first(self) -> int:
        """Index of the oldest keyframe that is kept; of the next one if none is."""
        return 0 if self.num_on_disk else self._first_in_memory

    @property
    def _first_in_memory(self) -> int:
        return len(self) - len(self._kept)

    def append(self, step: Step) -> None:
        """Add the step of the next keyframe."""
        self.stamps_ns.append(step.stamp_ns)
        self._kept.append(step)
        if self._in_memory is not None and len(self._kept) > self._in_memory:
            self._put_on_disk()

    def _put_on_disk(self) -> None:
        """Move the oldest step to disk; if writing fails, all steps stay in memory from now on."""
        try:
            self._disk.append(pickle.dumps(self._kept[0], protocol=pickle.HIGHEST_PROTOCOL))
        except OSError as fault:
            self._in_memory, self.disk_fault = None, fault.strerror or str(fault)
        else:
            self._kept.popleft()
            self._ends.append(self._disk.length)

    def __getitem__(self, keyframe: int) -> Step:
        """The step of a keyframe. Raises IndexError if it is forgotten, LostComponentError if the disk fails."""
        if keyframe < self.first:
            raise IndexError(f"keyframe {keyframe} is forgotten; the oldest that is kept is {self.first}")
        at = keyframe - self._first_in_memory
        return self._kept[at] if at >= 0 else self._from_disk(keyframe)

    def _from_disk(self, keyframe: int) -> Step:
        begin, end = self._ends[keyframe : keyframe + 2]
        try:
            data = self._disk.read(end - begin, begin)
        except OSError as fault:
            raise LostComponentError(f"keyframe {keyframe} cannot be read from disk again ({fault.strerror})") from None
        step: Step = pickle.loads(data)  # safe: only this process can have written the file
        return step

    def forget_before(self, keyframe: int) -> None:
        """Drop steps in memory before a keyframe; those on disk stay."""
        while self._kept and self._first_in_memory < keyframe:
            self._kept.popleft()

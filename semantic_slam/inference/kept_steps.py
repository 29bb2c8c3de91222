"""Storage of the keyframes, as any may have to be replayed: those of long ago on disk."""

import pickle
from array import array
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import overload

from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.nameless_file import NamelessFile


class KeptSteps(Sequence[Step]):
    """Steps by keyframe, and the stamps of all keyframes, which enter the ids of hypotheses."""

    def __init__(self, steps: Iterable[Step] = (), *, in_memory: int | None = None) -> None:
        """``in_memory``: number of steps kept in memory; older ones go to disk unless it is full. None: all stay."""
        self.stamps_ns = array("q")
        self.disk_fault = ""  # system's error message if steps can no longer be written to disk, else ""
        self._in_memory = in_memory
        self._kept: deque[Step] = deque()
        self._disk = NamelessFile()
        self._ends = array("q", [0])  # byte offset on disk where each step ends
        for step in steps:
            self.append(step)

    def __len__(self) -> int:
        """Number of keyframes so far."""
        return len(self.stamps_ns)

    @property
    def num_on_disk(self) -> int:
        """Number of keyframes on disk; these are the oldest ones."""
        return len(self._ends) - 1

    def go_on(self, stamps_ns: "array[int]", newest: Sequence[Step] = ()) -> None:
        """Hold the stamps of earlier keyframes, after a restart, and the ``newest`` of their steps; no others."""
        self.stamps_ns, self._kept = stamps_ns, deque(newest)
        self._disk = NamelessFile()
        self._ends = array("q", bytes(self._ends.itemsize * (len(stamps_ns) - len(newest) + 1)))

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

    def __iter__(self) -> Iterator[Step]:
        return (self[keyframe] for keyframe in range(len(self)))

    @overload
    def __getitem__(self, keyframe: int) -> Step: ...

    @overload
    def __getitem__(self, keyframe: slice) -> list[Step]: ...

    def __getitem__(self, keyframe: int | slice) -> Step | list[Step]:
        """The step of a keyframe, counted from the end if it is negative, or those of a slice.

        Raises IndexError if it has not come yet, LostComponentError if the disk fails.
        """
        every = range(len(self))[keyframe]
        return [self._step(own) for own in every] if isinstance(every, range) else self._step(every)

    def _step(self, keyframe: int) -> Step:
        at = keyframe - self.num_on_disk
        return self._kept[at] if at >= 0 else self._from_disk(keyframe)

    def _from_disk(self, keyframe: int) -> Step:
        begin, end = self._ends[keyframe : keyframe + 2]
        if begin == end:
            raise LostComponentError(f"keyframe {keyframe} was forgotten at a restart")
        try:
            data = self._disk.read(end - begin, begin)
        except OSError as fault:
            raise LostComponentError(f"keyframe {keyframe} cannot be read from disk again ({fault.strerror})") from None
        step: Step = pickle.loads(data)  # safe: only this process can have written the file
        return step
